"""Report on the results folder of any command, as a self-contained HTML page."""
