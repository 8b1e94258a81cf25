"""The deadlock measure: standing, away from the goal, though the policy wants to move."""

import numpy as np

from hcbf_gym.evaluation.measures import deadlocked


def test_standing_with_a_wish_to_move_away_from_the_goal_alone_is_a_deadlock():
    velocity = np.array([[0.01, 0.0], [1.0, 1.0], [0.01, 0.0], [0.01, 0.0]])
    u_nominal = np.array([[1.0, 1.0], [1.0, 1.0], [0.0, 0.0], [1.0, 1.0]])
    found = deadlocked(velocity, u_nominal, np.array([2.0, 2.0, 2.0, 0.2]), 0.25)
    assert found.tolist() == [True, False, False, False]
