"""What is known of the robot: reduced-order models ẋ = f(x) + g(x)u and input sets U."""
