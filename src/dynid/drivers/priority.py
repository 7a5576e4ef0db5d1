"""Ask the system to run this process before others: a late command jerks the arm, a late reader loses its state."""

from __future__ import annotations

import os

#: Lowest real-time priority: before all usual programs, after those that the system itself runs in real time.
REAL_TIME = 1
#: Niceness where real time is not allowed.
NICENESS = -10


def raise_priority() -> str:
    """Raise the priority of this thread and those it starts later; return what was granted."""
    try:
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(REAL_TIME))
    except (OSError, AttributeError):
        pass
    else:
        return "real time"
    try:
        os.setpriority(os.PRIO_PROCESS, 0, NICENESS)
    except (OSError, AttributeError):
        return "usual"
    return f"nice {NICENESS}"
