"""What ROS starts of hcbf-gym."""
