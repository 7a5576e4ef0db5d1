"""Robot drivers: what each publishes, which traps it sets, and how it is commanded; one file per driver.

``interface.driver_of`` gives the driver of a robot file. Only ``ros`` imports ROS, and only when something is recorded.
"""
