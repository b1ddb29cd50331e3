"""Seeds by purpose: ranges that no other purpose uses.

Training uses the seeds of its run, evaluations during it those from 1,000,000 on, studies of hyper-parameters those
from 2,000,000 on, recorded scores of shipped policies those from 20,000 on, studies of identifiability those from
5,500,000 to 5,599,999. Recipes of training were chosen on those from 6,000,000 on.
"""

from __future__ import annotations

VALIDATION = range(3_000_000, 3_000_250)
"""Choosing: among trained policies, among opponents, among variants of either."""

TUNING = range(5_000_000, 5_100_000)
"""Tuning the settings of opponents, that is of controllers that are not trained."""

TENSION_LIMITS = range(5_600_000, 5_600_400)
"""Other limits of tension than that of training, in benchmarks/tension_limit.py."""

TEST = range(9_000_000, 9_001_000)
"""The tables: nothing is chosen here."""

TAILS = range(9_500_000, 9_600_000)
"""Counting episodes that fail, of which there are few in thousands, in benchmarks/opponents.py."""

MANY_VALIDATION, MANY_TEST = range(3_100_000, 3_110_000), range(9_600_000, 9_610_000)
"""Episodes with many mechanisms, for choosing and for the table, in benchmarks/generalist.py."""

DESIGNS_TO_CHOOSE, DESIGNS_TO_TEST = range(1_000_000, 2_000_000), range(2_000_000, 3_000_000)
"""Numbers of designs, not seeds: mechanisms for tuning and choosing, and for the table. Training has those below."""

ROBOTS = range(20_000_000, 22_000_000)
"""Robots that nobody modelled: a thousand of each."""

BENCH = range(22_000_000, 24_000_000)
"""Adapting to robots: what they did on the bench, and their models since. A thousand of each robot's own."""

DATA = range(30_000_000, 2**31)
"""Datasets for learning offline."""
