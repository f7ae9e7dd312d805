"""Links to external programs that control the tractor, one folder per program family."""
