"""Links: programs outside the package that drive the tractor, each in a folder of its own."""
