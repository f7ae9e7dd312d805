"""Test bench: tyres on a rig, and manoeuvres of `validate`, compared with theory."""
