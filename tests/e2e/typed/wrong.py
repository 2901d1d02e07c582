"""Mistakes: a type checker reports each line that ends in `# wrong`."""

import numpy as np

import jointstiff as js

run = js.identify("campaign.json")
js.identify("campaign.json", methd="partial_pose")  # wrong
js.identify("campaign.json", method="partial")  # wrong
js.identify("campaign.json", constraint=True)  # wrong
js.identify("campaign.json", loss="absolute")  # wrong
js.identify("campaign.json", positive="yes")  # wrong
js.identify()  # wrong
js.identify("campaign.json", confidence="95 %")  # wrong
run.joint["joint_2"]  # wrong
run.joints["joint_2"].stifness  # wrong
run.joints["joint_2"].stiffness + 1.0  # wrong
run.result.assessment  # wrong
run.result.asessment  # wrong
js.identfy("campaign.json")  # wrong
js.plan("campaign.json", reading=6)  # wrong
js.predict(run, np.zeros((3, 6)), force=(0.0, 0.0, -500.0))  # wrong
js.compare(run, runs=[run])  # wrong
js.map(run, force=(0, 0, -900), area="all")  # wrong
js.Client()  # wrong
run.save()  # wrong
run.correct(np.zeros((3, 6)), frame=(0, 0, 0))  # wrong
js.identify_many("a.json", executors=2)  # wrong
run.plot(titel="all joints")  # wrong
text: str = js.identify("campaign.json")  # wrong
js.load("run.json", "run").stifness  # wrong
js.load("run.json", "results")  # wrong
run.save("run.png", dpi="300")  # wrong
run.rsquared()  # wrong
run.cov_param()  # wrong
