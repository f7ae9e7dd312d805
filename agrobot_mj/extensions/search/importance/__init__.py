"""Importance of uncertain parameters: fraction of a metric's variance caused by each random parameter of a sweep.

A screening is a regression on about ten samples. Sobol indices need hundreds of samples. Both methods report parameters
that the samples cannot distinguish.
"""
