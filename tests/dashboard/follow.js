async (run) => {
  const source = new EventSource(`/v1/jobs/${run}/events`);
  return new Promise((tell) => {
    source.addEventListener("end", () => { source.close(); tell("end"); });
    source.addEventListener("error", () => { source.close(); tell("refused"); });
  });
}
