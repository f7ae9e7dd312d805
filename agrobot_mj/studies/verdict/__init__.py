"""The verdict of docs/verdict.md: what the paper claims beside null models, and how much each guidance law survives."""
