"""Links to external programs that drive the tractor, one folder per program family."""
