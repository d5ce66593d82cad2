"""The measured quality of a run: figures taken from its files alone, by code that the solvers do not use."""

from imitor.metrics.report import METRICS_FILE, SCHEMA, evaluate, evaluate_dir, write

__all__ = ["METRICS_FILE", "SCHEMA", "evaluate", "evaluate_dir", "write"]
