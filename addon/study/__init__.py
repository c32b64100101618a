# SPDX-License-Identifier: GPL-3.0-or-later
"""Studies: LeapRay beside Cycles, and its traversers beside each other."""
