"""The numbers of this folder that decide something: unit, meaning, evidence."""

# ---------------------------------------------------------------- physics
#: Step of the physics where none is given [s]. evidence: none yet.
PHYSICS_STEP_S = 5e-4
#: Natural frequency of the error of the simulated joint controllers [Hz]. evidence: none yet.
CONTROLLER_FREQUENCY_HZ = 15.0
#: Longest step of the physics behind a driver [s]; there is at least one between two samples. evidence: none yet.
LONGEST_STEP_S = 1e-3
#: A late simulation lets other threads read commands after so many steps, for so long [s]. evidence: none yet.
STEPS_AT_ONCE, LATE_PAUSE_S = 10, 5e-4

# ---------------------------------------------------------------- controllers and drivers, as their sources have them
#: Kinova's firmware takes one command each so many seconds from a queue of so many.
#: evidence: kinova-ros, kinova_driver.
COMMAND_PERIOD_S, QUEUE_LENGTH = 0.01, 2000
#: Periods that its last velocity is held when no message came. evidence: none yet.
VELOCITY_HELD_PERIODS = 5
#: Smoothing of a controller's reference [Hz]. evidence: none yet.
SMOOTHING_FREQUENCY_HZ = 5.0
#: FRI sends no velocity; the LWR4+ node differentiates and smooths with this share of the new value.
#: evidence: CentroEPiaggio/kuka-lwr, lwr_hw.
FRI_SMOOTHING = 0.2

# ---------------------------------------------------------------- motions and hidden torques
#: Sines of each joint, and the highest harmonic of the period among them. evidence: none yet.
SINES_A_JOINT, HIGHEST_HARMONIC = 6, 14
#: The window of a motion rises over the first time after a rest of the second one, and falls likewise [s].
#: evidence: none yet.
WINDOW_RISE_S, WINDOW_REST_S = 2.5, 0.5
#: What a joint without limits gets to either side, turning [rad] and sliding [m]. evidence: none yet.
FREE_TURN_RAD, FREE_SLIDE_M = 3.141592653589793, 0.3
#: Random motions of which one must stay above the floor. evidence: none yet.
RANDOM_MOTIONS = 300
#: Step of the physics [s] under hidden torques, and steps a sample of the log.
#: evidence: with steps of 2.5 ms the integrator's error passes the noise of the sensors.
HIDDEN_STEP_S, HIDDEN_STEPS_A_SAMPLE = 1.25e-3, 4

# ---------------------------------------------------------------- exported files along a recording
#: Natural frequency of the controller that holds a simulated arm near a recorded motion [Hz]: so soft that what a model
#: lacks moves the arm, so stiff that it does not drift away. evidence: none yet.
SOFT_FREQUENCY_HZ = 1.0
#: It is at least so stiff that the spread of the measured torque would bend it by this [rad or m]: light wrists carry
#: more than their own inertia. evidence: without it the wrist of the LWR4+ strays by 1 rad and says nothing.
SOFT_DEFLECTION = 0.1
#: Longest part of a recording that `dynid gap --apply` simulates [s]: ten periods of that controller, 2 s of work.
#: evidence: errors of LWR4+ run 3 over its last 10 s and over all 25 s, 45.9 and 46.6 mrad.
DRIVEN_S = 10.0
