# SPDX-License-Identifier: GPL-3.0-or-later
"""What frames and runs keep: in memory and in files."""
