"""The numbers that decide something in the workflows, each with its unit, meaning and evidence."""

from __future__ import annotations

from typing import Any

#: How long a scheduler that does not answer, or a first worker, is waited for [s].
#: evidence: none yet (a scheduler and its workers start in 2 s, on a machine with ten times the load in 20 s).
SCHEDULER_PATIENCE = 30.0
#: How often it is seen to that all workers of this machine are there [s]. evidence: none yet.
WORKERS_SEEN_TO = 0.2
#: Dask's settings of scheduler and workers of this machine.
DASK: dict[str, Any] = {
    # Workers that may die under one job before it is taken to be what kills them.
    # evidence: benchmarks/cluster.py kills, ten workers killed at random under 14 jobs; of 3 a job dies now and then.
    "distributed.scheduler.allowed-failures": 5,
    # Jobs that a worker holds: one that only waits there would be blamed for the worker's death.
    "distributed.scheduler.worker-saturation": 1.0,
    # Share of its memory beyond which a worker is ended; a job holds its memory itself, so that nothing can be put
    # aside, and a worker that waits for less would wait for ever.
    "distributed.worker.memory.target": False,
    "distributed.worker.memory.spill": False,
    "distributed.worker.memory.pause": False,
    "distributed.worker.memory.terminate": 0.95,
    # evidence: benchmarks/cluster.md, processes that only wait would take a tenth of a core with Dask's own intervals.
    "distributed.worker.memory.monitor-interval": "500ms",
    "distributed.admin.tick.interval": "500ms",
    "distributed.admin.system-monitor.interval": "5s",
    "distributed.worker.profile.enabled": False,
    "distributed.worker.http.routes": [],
    # evidence: benchmarks/cluster.md, with Dask's limit for giving memory back arrays cost a third more processor.
    "distributed.nanny.pre-spawn-environ": {},
}
