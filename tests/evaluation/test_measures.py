"""The deadlock measure: standing, away from the goal, though the policy wants to move."""

import numpy as np

from hcbf_gym.evaluation.measures import deadlock_share, deadlocked


def test_only_standing_with_a_wish_to_move_away_from_the_goal_is_a_deadlock():
    slow, fast, asks, rests = np.array([0.01, 0.0]), np.ones(2), np.ones(2), np.zeros(2)
    assert deadlocked(slow, asks, np.array(2.0), 0.25)
    assert not deadlocked(fast, asks, np.array(2.0), 0.25)
    assert not deadlocked(slow, rests, np.array(2.0), 0.25)
    assert not deadlocked(slow, asks, np.array(0.2), 0.25)


def test_the_share_counts_steps():
    velocity = np.array([[0.0, 0.0], [0.0, 0.0], [1.0, 0.0], [0.0, 0.0]])
    u_nominal, distance = np.full((4, 2), 5.0), np.array([3.0, 3.0, 3.0, 0.1])
    assert deadlock_share(velocity, u_nominal, distance, 0.25) == 0.5
