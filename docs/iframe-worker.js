// Browsers start no worker from a page on the disk, and the search is one. There it runs in a hidden frame instead, which
// has the two ends of a worker: messages go in as events, and come out by postMessage. The theme looks for the name.
if (location.protocol === "file:") {
  window.IFrameWorker = window.Worker = class extends EventTarget {
    constructor(url) {
      super();
      const frame = document.createElement("iframe");
      frame.hidden = true;
      document.body.append(frame);
      this.inside = frame.contentWindow;
      this.inside.postMessage = (data) => this.dispatchEvent(new MessageEvent("message", { data }));
      const script = frame.contentDocument.createElement("script");
      this.started = new Promise((resolve, reject) => Object.assign(script, { src: url, onload: resolve, onerror: reject }));
      frame.contentDocument.head.append(script);
    }

    async postMessage(data) {
      await this.started;
      this.inside.dispatchEvent(new MessageEvent("message", { data: structuredClone(data) }));
    }
  };
}
