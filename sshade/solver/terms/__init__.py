"""The terms of the energy."""

from sshade.solver.terms.arap import Arap
from sshade.solver.terms.bending import Bending
from sshade.solver.terms.pulls import Pulls
from sshade.solver.terms.struts import Struts
from sshade.solver.terms.term import Term

#: All terms, in the order in which sums are taken. The first one is always on.
TERMS: tuple[type[Term], ...] = (Arap, Bending, Pulls, Struts)
