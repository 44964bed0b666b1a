"""Processor time for benchmarks on a machine that others share: limits and times of a plan by the process's own clock.

A busy machine takes time from a plan by the clock on the wall, none from its processor time. With OMP_NUM_THREADS=1
the two are the same on a quiet machine.
"""

from __future__ import annotations

import argparse
import time


class ProcessorTime(argparse.Action):
    """The option `--processor-time`: `time.perf_counter`, hdplan's clock, is the process's from here on."""

    def __init__(self, option_strings: list[str], dest: str) -> None:
        """Take no value, and be False unless given."""
        super().__init__(option_strings, dest, nargs=0, default=False, help="limits and times by the process's clock")

    def __call__(self, parser: argparse.ArgumentParser, namespace: argparse.Namespace, *_: object) -> None:
        """Set the clock."""
        setattr(namespace, self.dest, True)
        time.perf_counter = time.process_time
