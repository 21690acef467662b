// A page without a browser, for player.js: elements that take what they are told, and canvases that note what is drawn.
// Arguments: the player, and a file with the replays as JSON. Prints for every step what was drawn on the map.

"use strict";
const { readFileSync } = require("node:fs");
const vm = require("node:vm");
const [player, replays] = process.argv.slice(2).map((name) => readFileSync(name, "utf8"));

const drawn = [];
let images = 0;

function context() {
  const methods = {
    createImageData: (width, height) => ({ data: new Uint8ClampedArray(4 * width * height) }),
    putImageData: (image) => { images++; drawn.push(["map", image.data]); },
  };
  return new Proxy({}, {
    get: (own, name) => methods[name] || (name in own ? own[name] : (...values) => {
      for (const value of values) if (typeof value === "number" && !Number.isFinite(value)) throw new Error(`${name}(${values})`);
      if (name === "lineTo") drawn.push([own.strokeStyle, ...values]);
      if (name === "arc") drawn.push([own.fillStyle, ...values]);
    }),
    set: (own, name, value) => { own[name] = value; return true; },
  });
}

function element(more = {}) {
  const own = context();
  return { dataset: {}, style: { setProperty() {} }, classList: { add() {}, remove() {}, toggle() {} }, options: [], value: "",
    clientWidth: 400, clientHeight: 400, children: {}, getContext: () => own, setAttribute() {}, addEventListener() {},
    querySelectorAll: () => [], checked: true, replaceChildren(...all) { this.options = all; if (all[0]) this.value = all[0].value ?? ""; },
    querySelector(name) { return this.children[name] ??= element(); }, ...more };
}

const byId = { replays: element({ textContent: replays }) };
const stages = [element(), element()];
const document = {
  documentElement: element(), getElementById: (id) => byId[id] ??= element(), createElement: () => element(),
  querySelector: () => element(), querySelectorAll: (name) => (name === ".stage" ? stages : []),
};
class Option { constructor(text, value) { this.text = text; this.value = String(value); } }
class ResizeObserver { observe() {} }
const jump = {};
byId.step = element({ addEventListener: (_, act) => { jump.act = act; } });

vm.runInNewContext(player, { document, window: {}, Option, ResizeObserver, requestAnimationFrame() {}, cancelAnimationFrame() {},
  performance, Blob, DecompressionStream, Response, atob, Uint8Array, TextDecoder, console });

(async () => {
  for (let i = 0; !byId.step.max && i < 200; i++) await new Promise((done) => setTimeout(done, 10));
  if (byId.trouble && byId.trouble.hidden === false) throw new Error(byId.trouble.textContent);
  const shown = [];
  const steps = [...Array(byId.step.max + 1).keys()];
  for (const step of [...steps, ...steps.reverse()]) {
    byId.step.value = step;
    drawn.length = 0;
    jump.act();
    const map = drawn.filter(([what]) => what === "map").map(([, data]) => Buffer.from(data).toString("base64"));
    shown.push({ step, map: map.at(-1) ?? null, lines: drawn.filter(([what]) => what !== "map") });
  }
  process.stdout.write(JSON.stringify(shown));
})();
