"""Nodes for ROS 1 through rospy. Never in one process with ROS 2: its modules have the same names."""
