"""The MuJoCo tractor: sole owner of MjModel and MjData.

MuJoCo's warnings are counted and go to the console; a log file of its own in the working directory they get only where
the user names one.
"""

import mujoco

DEFAULT_LOG = "MUJOCO_LOG.TXT"
"""File that MuJoCo would write into the working directory."""


def _leave_no_log() -> None:
    """Keep MuJoCo from writing its default log file."""
    logging = mujoco.MjLogConfig.get()
    if logging.logfile == DEFAULT_LOG:
        logging.logto_file = False
        logging.set()


_leave_no_log()
