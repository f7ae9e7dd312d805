"""Which uncertain number matters? The fraction of a metric's variance that each draw of a sweep may be responsible for.

A screening is a regression on some ten samples, Sobol indices need hundreds; both say what they cannot tell apart.
"""

from agrobot_mj.extensions.search.importance.results import importance, importance_table, importance_text

__all__ = ["importance", "importance_table", "importance_text"]
