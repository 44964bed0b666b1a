"""Seeded campaigns against hdplan, each judged by code of its own: see benchmarks/siege.py."""
