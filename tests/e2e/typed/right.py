"""Right uses: a type checker reports nothing."""

import numpy as np

import jointstiff as js

run = js.identify("campaign.json", method="partial_pose", positive=True, loss="huber")
stiffness: float | None = run.joints["joint_2"].stiffness
again = js.identify(run, method="CP", leave_out=["posture 3"], confidence=0.9)
runs = js.identify_many(["a.json", "b.json"])
compared = js.compare(run, again, ordered=True)
compared.save("compared.json")
frame = compared.to_frame()
plan = js.plan("campaign.json", readings=6, goal="15 %")
plan.save("plan.csv")
prediction = js.predict(run, "postures.csv")
deflections = js.predict(run, np.zeros((3, 6)), (0.0, 0.0, -500.0), units="m, rad, N, N.m").displacement
area = js.map(run, area=((1.2, -0.3, 0.6), (1.6, 0.3, 0.9)), force=(0, 0, -900))
area.plot()
print(area.summary())
program = js.correct(run, "pocket.src", force=(0, 0, -500), accuracy_option="off")
geometry = js.geometry("sweeps.json")
run.save("run.json")
any_kind = js.load("run.json")
any_kind.joints["joint_2"]
loaded = js.load("run.json", "run")
interval = loaded.joints["joint_2"].stiffness_interval
corrected = run.correct(np.zeros((3, 6)), tool=(0, 0, 200, 0, 0, 0), forces=(0, 0, -500))
robot = js.robot("KUKA KR 210 R2700 extra")
if run.result is not None:
    verdict: str = run.result.assessment.verdict
    intervals = [each.stiffness_interval for each in run.result.joints]
with js.Client("http://127.0.0.1:8000") as client:
    served = client.identify("campaign.json", method="DPP")
    served.save("served.json")
parameters: np.ndarray = run.params
errors: list[float] = [float(each) for each in run.bse]
squared: float = run.rsquared
count: int = run.nobs
covariance: np.ndarray = run.cov_params()
left_over: np.ndarray = run.resid + run.fittedvalues
options: dict[str, object] = compared.get_params()
run.plot(dpi=300)
run.save("run.png", dpi=300)
text: str = run.to_latex()
print(run.details())
