// The socket: frames in, requests out.  It comes back by itself when the server does.

export class Live {
  constructor(token, name, onFrame, onState) {
    this.token = token;
    this.name = name;
    this.onFrame = onFrame;
    this.onState = onState;
    this.open();
  }

  open() {
    const socket = new WebSocket(`${location.origin.replace(/^http/, "ws")}/live`);
    this.socket = socket;
    socket.onopen = () => this.ask("hello", { name: this.name });
    socket.onmessage = (event) => {
      this.onState(true, "");
      this.onFrame(JSON.parse(event.data));
    };
    socket.onclose = (event) => {
      this.onState(false, event.reason);
      if (event.code !== 1008) setTimeout(() => this.open(), 1000);
    };
  }

  ask(what, fields = {}) {
    if (this.socket.readyState !== WebSocket.OPEN) return false;
    this.socket.send(JSON.stringify({ do: what, token: this.token, ...fields }));
    return true;
  }
}
