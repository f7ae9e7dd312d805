"""Basic modules used by the whole package: messages, configuration, errors, geometry, random numbers, kernels and
files."""
