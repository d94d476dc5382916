// The web socket with the live data. Every message is acknowledged, so that the server never sends ahead of this page; a
// hidden page gets no frames. A lost connection is opened again every second.

/** Calls handle(message) with every message, and online(whether connected, why not). */
export function connect(handle, online) {
  const address = `${location.protocol.replace("http", "ws")}//${location.host}/live`;
  let socket = null;
  let received = 0;

  const tell = (content) => socket?.readyState === WebSocket.OPEN && socket.send(JSON.stringify(content));

  function open() {
    socket = new WebSocket(address);
    received = 0;
    socket.onopen = () => { online(true); tell({ hidden: document.hidden }); };
    socket.onmessage = (event) => {
      received += 1;
      try {
        handle(JSON.parse(event.data));
      } finally {
        tell({ ack: received });
      }
    };
    socket.onclose = async () => {
      const known = await fetch("/api/run").then(({ status }) => status !== 403, () => true);
      online(false, known ? "rig web has ended, or the connection is interrupted"
        : "rig web was started again; open the address that it printed");
      setTimeout(open, 1000);
    };
  }

  document.addEventListener("visibilitychange", () => tell({ hidden: document.hidden }));
  open();
}
