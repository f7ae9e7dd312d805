"""Optional parts of the package; each brings its commands, kinds, tests and pages, and none imports another."""
