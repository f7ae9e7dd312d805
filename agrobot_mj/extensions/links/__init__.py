"""Links to external programs that control the tractor, with one folder for each family of programs."""
