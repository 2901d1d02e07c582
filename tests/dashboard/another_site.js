async ([service, run, robot]) => {
  const seen = [];
  const sent = async (path, options) => {
    try {
      const answer = await fetch(service + path, options);
      seen.push(answer.ok ? await answer.text() : "");
    } catch { seen.push(""); }
  };
  await sent("/v1/robots", {});
  await sent("/v1/robots", { method: "POST", mode: "no-cors", body: robot });
  await sent("/v1/robots", { method: "POST", body: robot, headers: { "Content-Type": "application/json" } });
  await sent("/v1/jobs/" + run, { method: "PATCH" });
  await sent("/v1/jobs/" + run, { method: "PATCH", mode: "no-cors" });
  await sent("/v1/jobs/" + run, {});
  return seen.join("");
}
