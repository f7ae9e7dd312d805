"""Fields: boundaries and plans of other programs, coverage planning and driving."""
