"""Nodes for ROS 2 through rclpy, Kilted or Jazzy. Never in one process with ROS 1: its modules have the same names."""
