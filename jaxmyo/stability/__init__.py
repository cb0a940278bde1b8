"""How stable elements and solves are: the inf-sup test, checkerboards, the extremes, random problems.

`jaxmyo stability` measures it all.
"""

from jaxmyo.stability.inf_sup import Constant, InfSup

__all__ = ["Constant", "InfSup"]
