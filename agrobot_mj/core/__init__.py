"""Shared foundations of the package: messages, specs, errors, geometry, random numbers, kernels, files."""
