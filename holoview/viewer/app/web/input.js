// Input that rendercanvas's view (renderview.js of rendercanvas 2.7) loses or reorders. Runs after the view was defined
// and before the first one is made, in the page that `holoview view --serve` serves and in widgets of notebooks.
{
  const prototype = window.BaseRenderView.prototype
  const registerEvents = prototype._registerEvents

  // What stays with the browser of all that is pressed with Ctrl or Cmd: reload, tabs and windows, address, zoom.
  const BROWSERS = ['r', 'w', 't', 'n', 'l', '+', '-', '=', '0']

  function isForViewer (event) {
    if (/^(F([1-9]|10)|Tab|Alt)$/.test(event.key)) return true
    const isChord = (event.ctrlKey || event.metaKey) && !event.altKey // with Alt it types a character on Windows
    return isChord && !BROWSERS.includes(event.key.toLowerCase())
  }

  // Movements and turns of the wheel that wait for the throttle would arrive after the clicks and keys that followed.
  prototype.setThrottle = function () { this._moveThrottle = this._wheelThrottle = 0 }

  prototype._registerEvents = function () {
    const image = this.viewElement
    const field = this._focusElement // takes the keys
    const options = { signal: this._abortController.signal }
    const held = new Map() // physical keys that are down, and the names under which they were sent

    this.setThrottle()
    this.releaseKeys = () => {
      for (const key of [...held.values(), 'Shift', 'Control', 'Alt', 'Meta']) {
        this.onEvent({ type: 'key_up', key, modifiers: [], timestamp: performance.now() / 1000 })
      }
      held.clear()
    }

    // Before the view's own listeners: keys of an input method that composes a character are no keys of the viewer.
    field.addEventListener('keydown', (event) => {
      if (event.isComposing) {
        event.stopImmediatePropagation()
        return
      }
      if (isForViewer(event)) event.preventDefault()
      held.set(event.code, event.key)
    }, options)

    registerEvents.call(this)

    // The view's own listener takes the keys 25 ms after a press of a button; until then they were lost.
    const takeKeys = () => field.focus({ preventScroll: true })
    image.addEventListener('pointerdown', takeKeys, options)
    image.addEventListener('focus', takeKeys, options) // the browser's own answer to the press comes after that

    field.addEventListener('keyup', (event) => {
      held.delete(event.code)
      if (event.key === 'Meta') this.releaseKeys() // macOS says nothing of keys that go up while Cmd is held
    }, options)

    // Keys that go up while another window has the keyboard aren't told.
    field.addEventListener('blur', (event) => { if (event.relatedTarget !== image) this.releaseKeys() }, options)

    // What an input method composes is text when it is finished: é from ´ and e, か from k and a.
    field.addEventListener('compositionend', (event) => {
      field.value = ''
      this.onEvent({ type: 'char', data: event.data, is_composing: false, input_type: 'insertText', timestamp: performance.now() / 1000 })
    }, options)
  }
}
