"""What the nodes of both generations of ROS share. Message packages have the same names in both."""
