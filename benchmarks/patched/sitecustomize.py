"""Every process that starts with this folder on its path does what ``constants.apply`` says."""

from constants import apply

apply()
