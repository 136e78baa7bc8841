"""Runs in Pose2Sim's environment: `run_pose2sim.py PROJECT`, a folder as its documentation has it.

Person association, triangulation and filtering; prints the seconds of the processor and of the
clock as JSON.
"""

import json
import os
import sys
import time

os.environ.setdefault("MPLBACKEND", "Agg")
os.chdir(sys.argv[1])

from Pose2Sim import Pose2Sim  # noqa: E402

cpu, clock = time.process_time(), time.perf_counter()
Pose2Sim.personAssociation()
Pose2Sim.triangulation()
Pose2Sim.filtering()
print(json.dumps({"cpu": time.process_time() - cpu, "clock": time.perf_counter() - clock}))
