"""Disk to nouns and back, without maths: robot files, results, logs."""
