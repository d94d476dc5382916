"""Problems of other projects: our values against exact ones, and programs of others where they are installed."""

import pytest
from others import OTHERS
from problems import PROBLEMS

REACHED = {
    "MuJoCo": 5e-3,
    "MuJoCo, noslip 10": 1e-6,
    "Drake, TAMSI": 1e-6,
    "PathSim": 1e-7,
    "siconos": 1e-5,
    "exudyn": 1e-6,
}


@pytest.mark.parametrize("name", [pytest.param(n, marks=[pytest.mark.slow] * (n == "lugre")) for n in PROBLEMS])
def test_the_value_of_a_problem_of_others(name):
    problem = PROBLEMS[name]
    assert abs(problem.ours().value - problem.exact()) <= problem.tolerance


@pytest.mark.parametrize("name", [name for name, problem in PROBLEMS.items() if problem.stored])
def test_what_they_publish_is_the_same_problem(name):
    problem = PROBLEMS[name]
    for value in problem.stored.values():
        assert value == pytest.approx(problem.ours().value, rel=1e-2, abs=1e-3)


@pytest.mark.peers
@pytest.mark.timeout(1200)
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("other", OTHERS, ids=lambda other: f"{other.name}: {other.problem}")
def test_others_are_given_the_same_problem(other):
    if not other.available():
        pytest.skip(f"{other.package} is not installed")
    problem = PROBLEMS[other.problem]
    error = abs(other.answer(other.steps[0])[0] - problem.exact())
    assert error <= REACHED[other.name]
    assert abs(problem.ours().value - problem.exact()) <= max(1e-3 * error, 1e-9)
