"""Few cases of a product of many."""

import itertools


def pairwise(*lists, allowed=lambda *_: True):
    """Return cases of a product in which any two entries that are allowed together stand once."""
    cases = [case for case in itertools.product(*lists) if allowed(*case)]
    pairs = [set(itertools.combinations(enumerate(map(str, case)), 2)) for case in cases]
    left, chosen = set().union(*pairs), []
    while left:
        k = max(range(len(cases)), key=lambda k: len(pairs[k] & left))
        left -= pairs[k]
        chosen.append(cases[k])
    return chosen
