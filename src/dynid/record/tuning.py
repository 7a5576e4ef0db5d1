"""The numbers of this folder that decide something: unit, meaning, evidence.

They keep an arm safe and are not tuned on benchmarks: their evidence is a rating, a standard, or what a driver does.
"""

import math

# ---------------------------------------------------------------- when a run is stopped
#: Largest distance between planned and measured position [rad or m]. evidence: none yet, no standard names one.
STOP_DEVIATION = 0.15
#: Longest time without a joint state [s]. evidence: a driver at 50 Hz, the least that is played with, may lose a dozen.
STOP_STALE_S = 0.25
#: Latest that a command may leave [s]. evidence: by then the arm has seen ten periods of silence at 100 Hz; a point
#: that a controller interpolates to is as far ahead, so that its way never ends in between.
STOP_LATE_S = 0.1
#: Largest share of a joint's rating, and the states in turn that it must be exceeded in.
#: evidence: the rating; one state may be a spike of the sensor.
STOP_TORQUE_SHARE, STOP_TORQUE_STATES = 0.8, 3

# ---------------------------------------------------------------- what a motion may do, before it moves
#: A predicted torque may take this share of the rating. evidence: below ``STOP_TORQUE_SHARE``, as friction may be
#: missing in the prediction.
PREDICTED_TORQUE_SHARE = 0.7
#: Poses at which distances are measured. evidence: a metre of path at a usual speed has one every few millimetres.
CLEARANCE_POSES = 2000
#: The planner measured at other samples of the same path, which may be this much farther away [m].
#: evidence: the spacing of those poses.
CLEARANCE_SLACK_M = 2e-3
#: Poses at which torques are predicted. evidence: none; it bounds time and memory.
TORQUE_POSES = 20000

# ---------------------------------------------------------------- what the arm must show before it moves
#: Joint states are listened to for this time [s]. evidence: 100 states at the least rate.
LISTENING_S = 2.0
#: Least rate of joint states [Hz]. evidence: none yet; accelerations cannot be found from fewer.
LEAST_RATE_HZ = 50.0
#: The arm may stand this far from the first pose [rad or m]. evidence: a third of ``STOP_DEVIATION``.
START_TOLERANCE = 0.05
#: A joint that turns without end may have been turned a few times by hand; more is degrees [rad]. evidence: none yet.
MOST_TURNS_RAD = 8 * math.pi
#: Torques beyond this multiple of the rating are in another unit. evidence: none yet.
MOST_RATINGS = 3.0
#: At rest a joint does not change by more than this while it is listened to [rad or m]. evidence: none yet.
STILL_WHILE_LISTENING = 0.02
#: Gravity is taken to be removed when every torque is below this share of the weight that the arm must carry, and the
#: weight is worth looking at [N m]. evidence: none yet.
NO_WEIGHT_SHARE, LEAST_WEIGHT_NM = 0.1, 5.0
#: Kinova's torque sensors are zeroed where gravity loads no joint: all joints at this angle [rad], this near to it, and
#: read less than this when they were zeroed [N m]. evidence: kinova-ros, README; tolerance and torque: none yet.
CANDLE_POSE_RAD, CANDLE_TOLERANCE_RAD, ZEROED_TORQUE_NM = math.pi, 0.05, 0.2

# ---------------------------------------------------------------- the approach
#: A slow approach uses this share of the velocity and acceleration limits. evidence: ISO 10218-1 ends reduced speed at
#: 0.25 m/s, which a tenth of 2.5 rad/s is at a metre.
APPROACH_SHARE = 0.1
#: Limits that stand in where the robot file has none [rad/s, rad/s^2]. evidence: as for ``APPROACH_SHARE``.
APPROACH_VELOCITY, APPROACH_ACCELERATION = 0.5, 1.0
#: Shortest approach [s], and its sample rate [Hz]. evidence: none yet.
SHORTEST_APPROACH_S, APPROACH_RATE_HZ = 2.0, 100.0
#: The arm's remaining distance to the start dies away over this time [s]. evidence: with ``START_TOLERANCE`` a quintic
#: then adds at most 1.875 times 0.05 rad/s.
BLEND_S = 1.0

# ---------------------------------------------------------------- the recording
#: The writer wakes up this often [s]. evidence: a crash loses no more.
WRITER_PERIOD_S = 0.02
#: The recording goes on this long after the last command [s], so that the end of the motion is in it.
#: evidence: none yet.
TAIL_S = 0.5
#: How often the main thread looks around [s]. evidence: a person's key is answered within it.
GLANCE_S = 0.05
#: The master is asked this often whether it lives, with this patience [s]; it has to miss two in a row.
#: evidence: none yet.
MASTER_INTERVAL_S, MASTER_PATIENCE_S = 0.5, 0.5
#: A stopped arm stands still within this time [s]: it changes by less than this between two looks [rad or m].
#: evidence: none yet.
STANDSTILL_S, STILL_AFTER_STOP = 1.0, 1e-3
#: Commands of standing still that end a motion, so that a velocity stream ends with zero. evidence: none yet.
RESTING_COMMANDS = 10
