# SPDX-License-Identifier: GPL-3.0-or-later
"""Benchmarks of the core alone; run.py runs them, and compares two commits."""
