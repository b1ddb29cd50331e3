/* Browsers start no Worker for a page that was opened from disk. Search runs in a hidden frame then. */
if (location.protocol === "file:") {
  window.Worker = class extends EventTarget {
    constructor(url) {
      super()
      this.queue = []
      this.frame = document.createElement("iframe")
      this.frame.hidden = true
      document.body.appendChild(this.frame)
      const inside = this.frame.contentWindow
      const script = inside.document.createElement("script")
      inside.postMessage = data => setTimeout(() => this.receive(data))  // as a worker's: never within the call
      inside.importScripts = (...urls) => Promise.all(urls.map(each => this.load(each)))
      script.src = new URL(url, location.href)
      script.onload = () => this.start()
      inside.document.body.appendChild(script)
    }

    load(url) {
      return new Promise((resolve, reject) => {
        const script = this.frame.contentWindow.document.createElement("script")
        script.src = url
        script.onload = resolve
        script.onerror = reject
        this.frame.contentWindow.document.body.appendChild(script)
      })
    }

    start() {
      const queue = this.queue
      this.queue = null
      queue.forEach(data => this.deliver(data))
    }

    deliver(data) {
      this.frame.contentWindow.dispatchEvent(new MessageEvent("message", { data }))
    }

    receive(data) {
      const event = new MessageEvent("message", { data })
      this.dispatchEvent(event)
      if (this.onmessage) this.onmessage(event)
    }

    postMessage(data) {
      if (this.queue) this.queue.push(data)
      else this.deliver(data)
    }

    terminate() {
      this.frame.remove()
    }
  }
}
