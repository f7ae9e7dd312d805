"""Numbers from a finished run: pure functions of its log."""
