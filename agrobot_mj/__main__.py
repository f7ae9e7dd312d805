"""Entry point of `python -m agrobot_mj`, which is equivalent to the command `agrobot-mj`."""

from agrobot_mj.cli import main

main()
