"""Field work: boundaries and plans from other programs, coverage planning, and simulation of the plans."""
