"""Entry point of `python -m agrobot_mj`, which is the same as the command `agrobot-mj`."""

from agrobot_mj.cli import main

main()
