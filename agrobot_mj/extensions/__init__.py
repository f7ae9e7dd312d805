"""Optional parts of the package with their own commands, kinds, tests and pages. No part imports another."""
