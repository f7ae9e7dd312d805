"""What docs/real_machine.md compares: logs of machines that exist, and the simulator beside them."""
