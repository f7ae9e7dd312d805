"""Many runs: comparisons, sweeps, limits, tuning, statistics and pages."""
