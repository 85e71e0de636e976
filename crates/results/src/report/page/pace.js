// How much effort a frame is worth while the view moves: the less, the longer frames take.

// Frames that take longer than this are drawn with less effort; those that take less than that allow more, milliseconds.
const SLOW_FRAME_MS = 34;
const QUICK_FRAME_MS = 24;
// The resolution goes down with the effort, to this share at least.
const LEAST_EFFORT = 0.35;
// The view rests when it has not moved for so long, milliseconds.
const REST_MS = 180;
// Once a picture at rest takes longer than this, movements begin with that effort.
const SLOW_REST_MS = 70;
const SLOW_EFFORT = 0.6;

class Pace {
  // `on.rest()`: the view rests; `on.slow()`: the machine was found to be slow.
  constructor(on) {
    this.on = on;
    // 1 at rest.
    this.effort = 1;
    // What the last movement took.
    this.moving = 1;
    // Whether frames have ever been slow: then what is small is drawn simply while the view moves.
    this.isSlow = false;
    this.timer = 0;
    this.last = 0;
    this.fence = null;
  }

  moved() {
    clearTimeout(this.timer);
    this.effort = this.moving;
    this.timer = setTimeout(() => { this.timer = 0; this.last = 0; this.effort = 1; this.on.rest(); }, REST_MS);
  }

  // A frame begins. Of two in a row, the time between them is what the first one cost.
  frame(now) {
    if (this.timer === 0) return;
    const took = now - this.last;
    if (this.last > 0 && took > SLOW_FRAME_MS) {
      this.slow();
      this.moving = Math.max(this.moving * Math.max(SLOW_FRAME_MS / took, 0.4), LEAST_EFFORT);
    } else if (this.last > 0 && took < QUICK_FRAME_MS) this.moving = Math.min(this.moving * 1.03, 1);
    this.last = now;
    this.effort = this.moving;
  }

  // A picture at rest was asked for: once the card has drawn it, its time tells whether movements can be drawn in full.
  watch(gl) {
    if (this.isSlow || this.fence || this.timer !== 0) return;
    const began = performance.now();
    this.fence = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
    gl.flush();
    const look = () => {
      const isDone = gl.getSyncParameter(this.fence, gl.SYNC_STATUS) === gl.SIGNALED || gl.isContextLost();
      if (!isDone) { setTimeout(look, 5); return; }
      gl.deleteSync(this.fence);
      this.fence = null;
      if (performance.now() - began > SLOW_REST_MS) this.slow();
    };
    setTimeout(look, 5);
  }

  slow() {
    if (this.isSlow) return;
    this.isSlow = true;
    this.moving = Math.min(this.moving, SLOW_EFFORT);
    this.on.slow();
  }

  get isSimple() { return this.timer !== 0 && this.isSlow; }
}
