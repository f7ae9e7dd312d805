"""Links to external programs that control the tractor, one folder per family of programs."""
