"""Optional extensions of the package with their own commands, kinds, tests and pages. No extension imports another."""
