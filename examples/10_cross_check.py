"""How far is the paper's analytic model from the plant after 1, 5 and 10 s, and why?"""

import nacs

found = nacs.crosscheck("nacs/fault-free", out="crosscheck", trials=1, at=[1.0, 5.0, 10.0], set={"run.ticks": 120, "phases": {}})
print(found.text)
