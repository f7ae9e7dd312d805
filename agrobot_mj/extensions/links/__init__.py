"""Links to external programs that control the tractor, with one folder per group of programs."""
