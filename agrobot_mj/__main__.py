"""`python -m agrobot_mj` is the command `agrobot-mj`."""

from agrobot_mj.cli import main

main()
