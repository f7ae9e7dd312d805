"""Probability of a rare failure with its confidence interval, estimated by splitting runs that approach failure."""
