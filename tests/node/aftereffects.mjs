// Parses a script as ECMAScript 3 and runs it against imitations of the objects of After Effects that it uses.
// Prints, as JSON, the project that it built.  node aftereffects.mjs SCRIPT
import fs from "node:fs";
import path from "node:path";
import vm from "node:vm";
import * as acorn from "acorn";

const script = process.argv[2];
const text = fs.readFileSync(script, "utf8");
acorn.parse(text, { ecmaVersion: 3, sourceType: "script" });

class Property {
  constructor() {
    this.children = {};
  }
  property(name) {
    return (this.children[name] ??= new Property());
  }
  addProperty(name) {
    const child = new Property();
    (this.added ??= []).push([name, child]);
    return child;
  }
  setValuesAtTimes(times, values) {
    if (times.length !== values.length) throw new Error("as many values as times");
    if (times.some((time, k) => k > 0 && time <= times[k - 1])) throw new Error("times must rise");
    this.keys = times.map((time, k) => [time, values[k], "LINEAR"]);
  }
  setValueAtTime(time, value) {
    (this.keys ??= []).push([time, value, "LINEAR"]);
  }
  setInterpolationTypeAtKey(number, type) {
    this.keys[number - 1][2] = type;
  }
}
class File {
  constructor(name) {
    this.fsName = path.resolve(name);
    this.exists = fs.existsSync(this.fsName);
    this.parent = { fsName: path.dirname(this.fsName) };
  }
}
const project = { footage: [], comps: [], undo: 0 };
const layersOf = (list) => ({
  add(source) {
    const layer = new Property();
    layer.source = project.footage.indexOf(source);
    list.unshift(layer); // a new layer goes on top
    return layer;
  },
  addNull() {
    const layer = new Property();
    layer.isNull = true;
    list.unshift(layer);
    return layer;
  },
});
const context = vm.createContext({
  $: { fileName: script },
  File,
  ImportOptions: function (file) { this.file = file; },
  Shape: function () {},
  MarkerValue: function (comment) { this.comment = comment; },
  MaskMode: { NONE: "NONE" },
  AlphaMode: { STRAIGHT: "STRAIGHT" },
  KeyframeInterpolationType: { HOLD: "HOLD", LINEAR: "LINEAR" },
  app: {
    beginUndoGroup() { project.undo += 1; },
    endUndoGroup() { project.undo -= 1; },
    project: {
      importFile(options) {
        const item = { file: options.file.fsName, sequence: options.sequence, mainSource: {} };
        project.footage.push(item);
        return item;
      },
      items: {
        addComp(name, width, height, aspect, duration, rate) {
          const list = [];
          const comp = { name, width, height, aspect, duration, rate, frameDuration: 1 / rate, list,
            markerProperty: new Property(), openInViewer() {} };
          comp.layers = layersOf(list);
          project.comps.push(comp);
          return comp;
        },
      },
    },
  },
});
vm.runInContext(text, context);
process.stdout.write(JSON.stringify(project));
