"""Shared base of the package: signals, configuration classes, errors, geometry, random numbers, kernels, files."""
