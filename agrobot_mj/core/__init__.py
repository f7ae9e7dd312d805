"""Modules used by the whole package: signals, configuration, errors, geometry, random numbers, kernels and files."""
