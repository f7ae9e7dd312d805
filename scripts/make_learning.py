"""docs/learning.md's numbers and figures: what the printed law does, and learners against laws that do not learn.

Runs go to runs/learning/*.jsonl, one line each, and are not repeated; delete the folder to begin anew.
"""

import argparse
import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from learning_study import COMPARED, PRINTED, SURFACES, Job, comparison_table, jobs, printed_table, run_job
from learning_study.figures import write_figures

ROOT = Path(__file__).parent.parent
