"""Parts against theory: the tyre rig and the manoeuvres that `validate` drives."""
