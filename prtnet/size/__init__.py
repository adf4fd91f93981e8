"""The smallest network that will do: candidates, a search among them, and what it expects of each."""

from prtnet.size.candidate import COSTS, VIEWS, Candidate, Found, Trial, Tried, within
from prtnet.size.predictor import expect
from prtnet.size.search import SHARES, search

__all__ = ["COSTS", "SHARES", "VIEWS", "Candidate", "Found", "Trial", "Tried", "expect", "search", "within"]
