"""The methods of back-analysis by the names that a project file gives them."""

from .adaptive_annealing import adaptive_annealing
from .annealing import paper, paper_eq15
from .evolution import evolution_search
from .levenberg import levenberg_search
from .sampling import random_search, sobol_search
from .searching import Search
from .surrogate import surrogate_search

METHODS: dict[str, Search] = {
    "paper": paper,
    "paper_eq15": paper_eq15,
    "random": random_search,
    "sobol": sobol_search,
    "adaptive": adaptive_annealing,
    "evolution": evolution_search,
    "surrogate": surrogate_search,
    "levenberg": levenberg_search,
}
