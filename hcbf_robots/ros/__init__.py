"""The filter as a ROS 2 node. Only `node` and `sim_node` import rclpy."""
