"""Test bench: tyre rig, data sheets, and validation manoeuvres compared with theory."""
