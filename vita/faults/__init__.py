"""The catalogue of faults, and the code that makes each one happen in simulation.

The page's buttons and the tests use the same injectors, so that what people can try is what is proven.
"""

from vita.faults.catalogue import CATALOGUE, Row
from vita.faults.registry import inject, injector, injectors
from vita.faults.site import Site
from vita.faults.tap import Tap

__all__ = ["CATALOGUE", "Row", "Site", "Tap", "inject", "injector", "injectors"]
