// A controller over `rig bridge`, from docs/wire.md alone. node wire_controller.mjs ADDRESS
// Node 22 or newer has WebSocket; with Node 20: node --experimental-websocket wire_controller.mjs ADDRESS

const socket = new WebSocket(process.argv[2]);
const send = (message) => socket.send(JSON.stringify(message));
let answered = 0;

socket.onopen = () =>
  send({ do: "admit", controller: "script", reads: ["vibrometer"], drives: ["load.force"], period_ns: 1e6 });

socket.onmessage = ({ data }) => {
  const { step, error, ended } = JSON.parse(data);
  if (error) {
    console.error(error);
    socket.close();
  } else if (step) {
    const velocity = step.values.vibrometer; // null while there is no number
    const command = Math.min(Math.max(20.0 - 200.0 * velocity, 0.0), 100.0); // the control law
    send({ do: "act", tick: step.tick, values: velocity === null ? [] : [command] });
    answered += 1;
  } else if (ended) console.log(`${ended} has ended after ${answered} steps`);
};

socket.onerror = ({ message }) => console.error(message || "the bridge cannot be reached");
