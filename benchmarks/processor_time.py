"""Processor time for benchmarks on a machine that others share: limits and times of a plan by the process's own clock.

A busy machine takes time from a plan by the clock on the wall, none from its processor time. With OMP_NUM_THREADS=1
the two are the same on a quiet machine.
"""

from __future__ import annotations

import argparse
import time


def add_processor_time(parser: argparse.ArgumentParser) -> None:
    """Add the option `--processor-time`, which `set_clock` heeds."""
    parser.add_argument(
        "--processor-time",
        action="store_true",
        help="count the planner's time by its processor time, on a machine that others share",
    )


def set_clock(options: argparse.Namespace) -> None:
    """Let `time.perf_counter`, hdplan's clock, be the process's from here on, where the options say so."""
    if options.processor_time:
        time.perf_counter = time.process_time
