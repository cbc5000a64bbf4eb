"""How far is the paper's analytic model from the plant after 1 and 5 s, and why?"""

import nacs

found = nacs.crosscheck("nacs/fault-free", out="crosscheck", trials=1, at=[1.0, 5.0], set={"run.ticks": 60, "phases": {}})
print(found.text)
