"""A simulated arm in MuJoCo, an engine that shares no equation with dynid's model: plant.yaml -> log.bag.

It makes the logs that ship with dynid, stands in for an arm in rehearsals and tests, and replays identified parameters.
"""
