const choices = buildChoices();
const transport = buildTransport(choices);
buildPlace();
const faults = buildFaults();
const wheel = buildWheel(choices);
buildTheme();
buildTraining();
link.listeners.push({
  setup(setup) {
    if (setup.title) document.getElementById('title').textContent = setup.title;
    if (setup.kind === 'drive') [choices, faults, wheel].forEach((part) => part.fill(setup));
  },
  frame(frame) {
    if (frame.playing !== undefined) transport.show(frame);
    if (frame.fault !== undefined) faults.show(frame.fault);
    if (frame.record) wheel.show(frame.record);
    document.documentElement.dataset.drive = link.setup.version; // what is shown is of this setup
  },
});
animate();
connect();
