"""The numbers that decide something in reading files."""

#: Messages that are decoded together: enough for NumPy; half or double makes no difference.
MESSAGES = 4096
#: Least share of distinct header stamps among the messages of a topic: a clock ticks. Evidence: none yet.
LEAST_DISTINCT = 0.5
#: Lines that show the dialect of a table. Evidence: headers of recorders have up to some tens of lines.
FIRST_LINES = 200

#: Start beyond which time counts from the first sample [s]. Evidence: 1e6 s are 11 days, which no recording has.
CALENDAR_FROM_S = 1e6
#: Median step up to which stamps are in each unit of time, of recorders from 2.5 Hz to 2 kHz.
#: Why not faster: a step of 0.2 is a slow log in seconds (E314), not one of 5 kHz in ms. Evidence: rates of drivers.
STEPS = {"s": 0.4, "ms": 400.0, "us": 4e5, "ns": 4e8}
#: Span of positions [rad] and size of torques [N m] beyond which an unknown recording is in degrees or mN m.
#: Evidence: 25 rad are four turns, which no joint with stops makes; none yet for the torque.
MOST_RADIANS, MOST_TORQUE_NM = 25.0, 2000.0

#: Miss of a multiple of 15 degrees up to which an angle is taken to mean it [rad]: 1.5708 must not break exact zeros.
#: Evidence: law; four digits behind the point miss by up to 5e-5.
SNAP_RAD = 1e-4
#: Size of gravity [m/s^2]. Evidence: law; 9.76 to 9.84 on Earth, with room for rounded values.
GRAVITY = (9.6, 9.9)
#: Share of an inertia by which the largest moment may exceed the other two together: a thin rod has two that are equal
#: and none. Evidence: law; what six digits leave out.
ROUNDED_INERTIA = 1e-6
#: Least time between two waypoints [s]: below it rounding decides in splines. Evidence: none yet.
LEAST_WAYPOINT_STEP_S = 1e-3
