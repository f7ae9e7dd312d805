"""Test bench: tyre rig, data sheets of machines, and validation manoeuvres whose results are compared with theory."""
