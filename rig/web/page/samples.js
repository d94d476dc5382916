// A worker that receives the samples of a sensor and passes them on to the thread of the sound card, so that the drawing
// of the page does not delay them. Its first message is {address, port}; it tells the page when the connection ends.

onmessage = ({ data: { address, port } }) => {
  const socket = new WebSocket(address);
  socket.binaryType = "arraybuffer";
  socket.onmessage = ({ data }) => {
    socket.send(""); // it has arrived
    const samples = new Float32Array(data.slice(8)); // before them: the time of the first one
    port.postMessage(samples, [samples.buffer]);
  };
  socket.onclose = () => postMessage("closed");
};
