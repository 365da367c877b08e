// All plots of a page, without network. Data are JSON inside the page; names enter as text only.
// 1. Seismograms beside their amplitude spectra (<script id="waves">): drag to zoom, double click to
//    see all, a cursor with values, switches for channels and motions.
// 2. Lines, dots and segments on axes (.plot, made by plots.py) as SVG: values under the pointer or,
//    with the arrow keys, of one point after the other.
(function () {
  "use strict";
  var waves = document.getElementById("waves"), data = waves ? JSON.parse(waves.textContent) : [];
  var GAP = 14, LEFT = 52, RIGHT = 8, BOTTOM = 26, NARROW = 560, SHARE = 0.6;

  function samples(text) {
    var raw = atob(text), bytes = new Uint8Array(raw.length), k;
    for (k = 0; k < raw.length; k++) bytes[k] = raw.charCodeAt(k);
    return new Int16Array(bytes.buffer);
  }

  function ticks(low, high, most) {
    var step = Math.pow(10, Math.floor(Math.log10((high - low) / most))), factor, out = [], k;
    for (factor of [1, 2, 5, 10]) if ((high - low) / (step * factor) <= most) break;
    step *= factor;
    for (k = Math.ceil(low / step); k * step <= high + 1e-9 * step; k++) out.push(k * step);
    return { at: out, digits: Math.max(0, -Math.floor(Math.log10(step) + 1e-9)) };
  }

  function short(value) { return Number(value.toPrecision(3)).toString(); }

  function viewer(box, place) {
    var traces = place.traces.map(function (t) {
      return { kind: t.kind, name: t.name, start: t.start, dt: t.dt, scale: t.scale,
               ppv: t.ppv, hz: t.hz, values: samples(t.values),
               amplitude: samples(t.spectrum.values), gain: t.spectrum.scale,
               low: t.spectrum.low, growth: t.spectrum.growth };
    });
    var colours = place.colours, row = Number(box.dataset.row || 118);
    var names = traces.map(function (t) { return t.name; }).filter(function (n, k, all) {
      return all.indexOf(n) === k; });
    var off = {}, all = [Infinity, -Infinity], view, cursor = null, drag = null;
    traces.forEach(function (t) {
      all[0] = Math.min(all[0], t.start);
      all[1] = Math.max(all[1], t.start + t.dt * (t.values.length - 1));
    });
    if (place.end !== null) all[1] = Math.min(all[1], place.end);
    view = all.slice();
    var canvas = document.createElement("canvas"), bar = document.createElement("div");
    var readout = document.createElement("p"), pen = canvas.getContext("2d");
    bar.className = "switches"; readout.className = "readout";
    box.append(bar, canvas, readout);
    names.concat(Object.keys(colours).filter(function (kind) {
      return traces.some(function (t) { return t.kind === kind; }); })).forEach(function (key) {
      var label = document.createElement("label"), tick = document.createElement("input");
      tick.type = "checkbox"; tick.checked = true;
      tick.onchange = function () { off[key] = !tick.checked; draw(); };
      if (colours[key]) label.style.color = colours[key];
      label.append(tick, " " + key); bar.append(label);
    });
    var back = document.createElement("button");
    back.textContent = "whole record";
    back.onclick = function () { view = all.slice(); draw(); };
    bar.append(back);

    function rows() { return names.filter(function (n) { return !off[n]; }); }
    function shownOf(name) {
      return traces.filter(function (t) { return t.name === name && !off[t.kind]; });
    }
    function wide() { return canvas.clientWidth >= NARROW; }  // else the spectra lie below
    function size() {
      var w = canvas.clientWidth, h = canvas.clientHeight, one = wide();
      return { w: one ? SHARE * w : w, h: one ? h : h / 2, whole: w, high: h };
    }
    function toX(time, w) {
      return LEFT + (time - view[0]) / (view[1] - view[0]) * (w - LEFT - RIGHT);
    }
    function toTime(x, w) {
      return view[0] + (x - LEFT) / (w - LEFT - RIGHT) * (view[1] - view[0]);
    }

    function draw() {
      var ratio = Math.max(2, window.devicePixelRatio || 1), list = rows(), s;
      var lines = Math.max(1, list.length) * row + BOTTOM;
      canvas.style.height = (wide() ? 1 : 2) * lines + "px";
      s = size();
      canvas.width = s.whole * ratio; canvas.height = s.high * ratio;
      pen.setTransform(ratio, 0, 0, ratio, 0, 0);
      pen.clearRect(0, 0, s.whole, s.high);
      pen.font = "11px system-ui, sans-serif";
      var high = (s.h - BOTTOM) / Math.max(1, list.length);
      list.forEach(function (name, k) { motion(name, k * high, high - GAP, s.w); });
      list.forEach(function (name, k) { spectrum(name, k * high, high - GAP, s); });
      axis(ticks(view[0], view[1], Math.max(3, s.w / 110)), "time [s]", 0, s.w, s.h,
           function (at) { return toX(at, s.w); });
      if (drag) {
        pen.fillStyle = "rgba(29,78,216,.12)";
        pen.fillRect(Math.min(drag.from, drag.to), 0, Math.abs(drag.to - drag.from), s.h - BOTTOM);
      }
      if (cursor !== null) {
        pen.strokeStyle = "#111"; pen.lineWidth = 0.7; pen.beginPath();
        pen.moveTo(cursor, 0); pen.lineTo(cursor, s.h - BOTTOM); pen.stroke();
      }
      say(s.w);
    }

    function axis(t, unit, left, right, bottom, at) {
      pen.fillStyle = "#444"; pen.textAlign = "center";
      t.at.forEach(function (v) { pen.fillText(v.toFixed(t.digits), at(v), bottom - 12); });
      pen.textAlign = "right"; pen.fillText(unit, right - 1, bottom - 1);
    }

    // Ordinates, unit and legend of a panel between left and right.
    function frame(t, toY, label, texts, left, right, top) {
      pen.textAlign = "right"; pen.lineWidth = 1;
      t.at.forEach(function (at) {
        pen.strokeStyle = Math.abs(at) < 1e-12 ? "#bbb" : "#eee"; pen.beginPath();
        pen.moveTo(left, toY(at)); pen.lineTo(right, toY(at)); pen.stroke();
        pen.fillStyle = "#666"; pen.fillText(at.toFixed(t.digits), left - 4, toY(at) + 4);
      });
      pen.fillStyle = "#222"; pen.textAlign = "left"; pen.fillText(label, left + 4, top + 12);
      var x = right - 2;
      pen.textAlign = "right";
      texts.slice().reverse().forEach(function (one) {
        pen.fillStyle = one.colour; pen.fillText(one.text, x, top + 12);
        x -= pen.measureText(one.text).width + 12;
      });
    }

    function motion(name, top, height, w) {
      var shown = shownOf(name), peak = 0;
      shown.forEach(function (t) { peak = Math.max(peak, largest(t)); });
      peak = peak || 1;
      function toY(value) { return top + 14 + (height - 14) * (0.5 - 0.48 * value / peak); }
      frame(ticks(-peak, peak, Math.max(4, row / 24)), toY, name + " [mm/s]", shown.map(function (t) {
        return { text: t.kind + ", PPV " + short(t.ppv), colour: colours[t.kind] };
      }), LEFT, w - RIGHT, top);
      pen.save(); pen.beginPath(); pen.rect(LEFT, top, w - LEFT - RIGHT, height + 4); pen.clip();
      shown.forEach(function (trace) {
        var first = Math.max(0, Math.floor((view[0] - trace.start) / trace.dt) - 1), k;
        var last = Math.min(trace.values.length - 1,
                            Math.ceil((view[1] - trace.start) / trace.dt) + 1);
        pen.strokeStyle = colours[trace.kind]; pen.lineWidth = 1.1; pen.beginPath();
        for (k = first; k <= last; k++)
          pen.lineTo(toX(trace.start + k * trace.dt, w), toY(trace.values[k] * trace.scale));
        pen.stroke();
      });
      pen.restore();
    }

    function spectrum(name, top, height, s) {
      var left = wide() ? s.w + LEFT : LEFT, right = s.whole - RIGHT, peak = 0;
      var shown = shownOf(name), below = wide() ? 0 : s.h;
      shown.forEach(function (t) {
        for (var k = 0; k < t.amplitude.length; k++)
          peak = Math.max(peak, t.amplitude[k] * t.gain);
      });
      peak = peak || 1; top += below;
      function toY(value) { return top + height - (height - 16) * value / (1.02 * peak); }
      function at(hz) { return left + hz / place.top * (right - left); }
      frame(ticks(0, peak, 4), toY, "amplitude [mm/s/Hz]", shown.map(function (t) {
        return { text: t.hz === null ? "silent" : "peak at " + short(t.hz) + " Hz",
                 colour: colours[t.kind] };
      }), left, right, top);
      shown.forEach(function (t) {
        pen.strokeStyle = colours[t.kind]; pen.lineWidth = 1.1; pen.beginPath();
        for (var k = 0; k < t.amplitude.length; k++)
          pen.lineTo(Math.min(right, at(t.low * Math.pow(t.growth, k))), toY(t.amplitude[k] * t.gain));
        pen.stroke();
      });
      axis(ticks(0, place.top, Math.max(3, (right - left) / 90)), "frequency [Hz]", left, s.whole, s.h + below, at);
    }

    function largest(trace) {
      var first = Math.max(0, Math.floor((view[0] - trace.start) / trace.dt)), most = 0, k;
      var last = Math.min(trace.values.length - 1, Math.ceil((view[1] - trace.start) / trace.dt));
      for (k = first; k <= last; k++) most = Math.max(most, Math.abs(trace.values[k]));
      return most * trace.scale;
    }

    function say(w) {
      if (cursor === null) { readout.textContent = "Drag to zoom, double click for the whole record."; return; }
      var time = toTime(cursor, w);
      readout.textContent = time.toFixed(4) + " s: " + traces.filter(function (t) {
        return !off[t.name] && !off[t.kind]; }).map(function (t) {
        var k = Math.round((time - t.start) / t.dt), v = t.values[k];
        return t.name + " " + t.kind + " " + (v === undefined ? "–" : short(v * t.scale));
      }).join(", ") + " mm/s";
    }

    function where(event) {
      var x = event.clientX - canvas.getBoundingClientRect().left;
      return Math.min(size().w - RIGHT, Math.max(LEFT, x));
    }
    canvas.onpointerdown = function (event) {
      drag = { from: where(event), to: where(event) }; canvas.setPointerCapture(event.pointerId);
    };
    canvas.onpointermove = function (event) {
      cursor = where(event);
      if (drag) drag.to = cursor;
      draw();
    };
    canvas.onpointerup = function () {
      var w = size().w, ends = drag && [toTime(drag.from, w), toTime(drag.to, w)].sort(
        function (a, b) { return a - b; });
      if (drag && Math.abs(drag.to - drag.from) > 8) view = ends;
      drag = null; draw();
    };
    canvas.onpointercancel = function () { drag = null; draw(); };
    canvas.onpointerleave = function () { if (!drag) { cursor = null; draw(); } };
    canvas.ondblclick = function () { view = all.slice(); draw(); };
    window.addEventListener("resize", draw);
    window.addEventListener("beforeprint", function () { cursor = drag = null; draw(); });
    draw();
  }

  var SVG = "http://www.w3.org/2000/svg", CHAR = 6.3, FOOT = 40, NEAR = 30;
  var SCALES = { viridis: ["#440154", "#46327e", "#365c8d", "#277f8e", "#1fa187", "#4ac16d", "#a0da39", "#fde725"],
                 greys: ["#000000", "#737373", "#d0d0d0"], darker: ["#d0d0d0", "#737373", "#000000"] };

  function element(name, attributes, parent, text) {
    var made = document.createElementNS(SVG, name);
    Object.keys(attributes).forEach(function (key) { made.setAttribute(key, attributes[key]); });
    if (text !== undefined) made.textContent = text;
    if (parent) parent.append(made);
    return made;
  }

  function blend(colours, share) {
    var at = Math.min(1, Math.max(0, share)) * (colours.length - 1), low = Math.min(colours.length - 2, Math.floor(at));
    function part(hex, k) { return parseInt(hex.slice(1 + 2 * k, 3 + 2 * k), 16); }
    return "rgb(" + [0, 1, 2].map(function (k) {
      return Math.round(part(colours[low], k) * (low + 1 - at) + part(colours[low + 1], k) * (at - low));
    }).join(",") + ")";
  }

  // Numbers of an axis: its ends by what is drawn unless they are given, its ticks and their texts.
  function ended(axis, values) {
    var known = values.filter(function (v) { return v !== null && (!axis.log || v > 0); });
    var low = axis.low, high = axis.high, least = Math.min.apply(null, known), most = Math.max.apply(null, known);
    if (!known.length) { least = low === null ? (axis.log ? 1 : 0) : low; most = least + 1; }
    var gap = axis.log ? 1.15 : 0.05 * (most - least || Math.abs(most) || 1);
    if (low === null) low = axis.log ? least / gap : least - gap;
    if (high === null) high = axis.log ? most * gap : most + gap;
    return { low: low, high: high > low ? high : low + 1, log: axis.log };
  }

  function marked(axis, ends, most) {
    if (axis.ticks) return axis.ticks;
    var out = [], power, k;
    if (!ends.log) {
      var t = ticks(ends.low, ends.high, most);
      return t.at.map(function (v) { return [v, Math.abs(v) >= 1e6 ? String(Number(v.toPrecision(3)).toExponential()).replace("+", "")
          : t.digits ? v.toFixed(t.digits) : String(Math.round(v))]; });
    }
    var decades = Math.log10(ends.high / ends.low), steps = decades < most / 2.5 ? [1, 2, 5] : [1];
    for (power = Math.floor(Math.log10(ends.low)); power <= Math.log10(ends.high); power++)
      for (k of steps) {
        var v = k * Math.pow(10, power);
        if (v >= ends.low * 0.999 && v <= ends.high * 1.001) out.push([v, short(v)]);
      }
    return out.filter(function (_, n) { return n % Math.ceil(out.length / most) === 0; });
  }

  function placed(ends, from, to) {
    function f(v) { return ends.log ? Math.log(v) : v; }
    return function (v) {
      if (v === null || (ends.log && !(v > 0))) return null;
      return from + (f(v) - f(ends.low)) / (f(ends.high) - f(ends.low) || 1) * (to - from);
    };
  }

  function said(axis, value) {
    var named = (axis.ticks || []).filter(function (t) { return t[0] === value; })[0];
    if (named) return named[1];
    return axis.label.replace(/ ?\[.*\]$/, "") + " " + Number(value.toPrecision(4)) + (/\[(.*)\]$/.exec(axis.label) || ["", ""])[1].replace(/^(?=.)/, " ");
  }

  function legend(box, part) {
    var row = document.createElement("div");
    row.className = "legend";
    part.marks.forEach(function (mark) {
      if (!mark.name) return;
      var one = document.createElement("span"), sign = document.createElement("b");
      sign.textContent = mark.kind === "dots" ? (mark.ring ? "○ " : "● ") : mark.dash ? "╌ " : "━ ";
      sign.style.color = mark.colour;
      one.append(sign, mark.name); row.append(one);
    });
    if (row.childNodes.length) box.append(row);
  }

  function panel(box, part, width, alt, readout) {
    var flat = function (key) { return [].concat.apply([], part.marks.map(function (m) {
      return m[key].concat(m["to_" + key] || []); })); };
    var ex = ended(part.x, flat("x")), ey = ended(part.y, flat("y"));
    legend(box, part);
    var yTicks = marked(part.y, ey, Math.max(3, part.height / 45)), right = part.scale ? 76 : 14;
    var longest = Math.max.apply(null, yTicks.map(function (t) { return t[1].length; }).concat(2));
    var left = Math.min(0.45 * width, longest * CHAR + (part.y.label ? 26 : 10)), height = part.height;
    if (part.equal) height = Math.min(1.4 * width, Math.max(160,
      (width - left - right) * (ey.high - ey.low) / (ex.high - ex.low) + FOOT + 8));
    var x = placed(ex, left, width - right); x.right = width;
    var y = placed(ey, height - FOOT, 8), points = [];
    var svg = element("svg", { width: width, height: height, viewBox: "0 0 " + width + " " + height,
                               role: "img", "aria-label": alt + " " + part.y.label + " over " + part.x.label, tabindex: 0 }, box);
    var xTicks = marked(part.x, ex, Math.max(2, (width - left) / 80));
    xTicks.forEach(function (t, n) {
      element("line", { x1: x(t[0]), x2: x(t[0]), y1: 8, y2: height - FOOT, stroke: "#e5e5e5" }, svg);
      var anchor = part.x.ticks && xTicks.length > 1 ? (n === 0 ? "start" : n === xTicks.length - 1 ? "end" : "middle") : "middle";
      element("text", { x: x(t[0]), y: height - FOOT + 15, "text-anchor": anchor }, svg, t[1]);
    });
    yTicks.forEach(function (t) {
      var room = Math.floor((left - 8 - (part.y.label ? 18 : 0)) / CHAR);
      if (!part.y.ticks) element("line", { x1: left, x2: width - right, y1: y(t[0]), y2: y(t[0]), stroke: "#e5e5e5" }, svg);
      var text = element("text", { x: left - 6, y: y(t[0]) + 4, "text-anchor": "end" }, svg,
                         t[1].length > room ? t[1].slice(0, room - 1) + "…" : t[1]);
      element("title", {}, text, t[1]);
    });
    element("path", { d: "M" + left + " 8V" + (height - FOOT) + "H" + (width - right), fill: "none", stroke: "#666" }, svg);
    element("text", { x: (left + width - right) / 2, y: height - 6, "text-anchor": "middle" }, svg, part.x.label);
    if (part.y.label) element("text", { x: 0, y: 0, transform: "translate(11 " + (height - FOOT) / 2 + ") rotate(-90)", "text-anchor": "middle" }, svg, part.y.label);
    part.marks.forEach(function (mark) { draw(svg, part, mark, x, y, height - FOOT, points); });
    if (part.scale) bar(svg, part.scale, width - 62, height);
    hover(svg, points, readout);
  }

  function draw(svg, part, mark, x, y, floor, points) {
    var style = { stroke: mark.colour, "stroke-width": mark.width || 1.5, fill: "none", opacity: mark.opacity || 1 };
    function told(k, value) {
      var words = [said(part.x, mark.x[k]), said(part.y, mark.y[k])];
      if (mark.to_x && mark.to_x[k] !== mark.x[k]) words[0] += " to " + short(mark.to_x[k]);
      if (mark.to_y && mark.to_y[k] !== mark.y[k]) words[1] += " to " + short(mark.to_y[k]);
      if (value !== undefined && value !== null) words.push(part.scale.label + " " + short(value));
      return [mark.name, mark.text && mark.text[k]].filter(Boolean).concat(words.join(", ")).join(": ");
    }
    var path = "", pen = "M";
    mark.x.forEach(function (value, k) {
      var px = x(value), py = y(mark.y[k]), end = mark.to_x && x(mark.to_x[k]);
      if (px === null || py === null) { pen = "M"; return; }
      if (mark.kind === "line") { path += pen + px.toFixed(1) + " " + py.toFixed(1); pen = "L"; }
      if (mark.kind === "segments")
        element("line", Object.assign({ x1: px, y1: py, x2: end, y2: y(mark.to_y[k]) }, style), svg);
      if (mark.kind === "dots") {
        var colour = mark.values ? blend(SCALES[part.scale.colours], placed(part.scale, 0, 1)(mark.values[k])) : mark.colour;
        element("circle", { cx: px, cy: py, r: mark.radius || 4, fill: mark.ring ? "none" : colour, opacity: mark.opacity || 1,
                            stroke: mark.ring ? colour : "#fff", "stroke-width": mark.ring ? 2 : 0.6 }, svg);
      }
      if (mark.text && !mark.quiet) {
        var outer = mark.to_x ? Math.max(px, end) : px, fits = outer + 7 + CHAR * mark.text[k].length < x.right;
        element("text", { x: outer + (fits ? 7 : -7), y: py + 4, "text-anchor": fits ? "start" : "end", "class": "halo" }, svg, mark.text[k]);
      }
      points.push({ x: mark.to_x ? end : px, y: mark.to_y ? y(mark.to_y[k]) : py, text: told(k, mark.values && mark.values[k]) });
    });
    if (!path) return;
    if (mark.fill) element("path", { d: path + "V" + floor + "H" + x(mark.x[0]).toFixed(1) + "Z", fill: mark.colour, opacity: 0.3 }, svg);
    if (mark.dash) style["stroke-dasharray"] = "5 4";
    element("path", Object.assign({ d: path, "stroke-linejoin": "round" }, style), svg);
  }

  function bar(svg, scale, left, height) {
    var steps = 40, high = height - FOOT - 8, at = placed(scale, height - FOOT, 8), k;
    for (k = 0; k < steps; k++)
      element("rect", { x: left, y: height - FOOT - (k + 1) * high / steps, width: 12, height: high / steps + 0.6,
                        fill: blend(SCALES[scale.colours], (k + 0.5) / steps) }, svg);
    marked({}, scale, 6).forEach(function (t) { element("text", { x: left + 16, y: at(t[0]) + 4 }, svg, t[1]); });
    element("text", { x: 0, y: 0, transform: "translate(" + (left - 5) + " " + (height - FOOT) / 2 + ") rotate(-90)", "text-anchor": "middle" }, svg, scale.label);
  }

  function hover(svg, points, readout) {
    var ring = element("circle", { r: 7, fill: "none", stroke: "#111", visibility: "hidden" }, svg), now = -1;
    function show(k) {
      now = k;
      ring.setAttribute("visibility", k < 0 ? "hidden" : "visible");
      if (k < 0) { readout.textContent = "Point, or use the arrow keys, for values."; return; }
      ring.setAttribute("cx", points[k].x); ring.setAttribute("cy", points[k].y);
      readout.textContent = points[k].text;
    }
    svg.onpointermove = function (event) {
      var place = svg.getBoundingClientRect(), zoom = svg.viewBox.baseVal.width / place.width, best = -1, least = NEAR * NEAR;
      points.forEach(function (p, k) {
        var far = Math.pow((event.clientX - place.left) * zoom - p.x, 2) + Math.pow((event.clientY - place.top) * zoom - p.y, 2);
        if (far < least) { least = far; best = k; }
      });
      show(best);
    };
    svg.onpointerleave = function () { show(-1); };
    svg.onkeydown = function (event) {
      var step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
      if (!step || !points.length) return;
      show((now + step + points.length) % points.length); event.preventDefault();
    };
    show(-1);
  }

  document.querySelectorAll(".plot").forEach(function (box) {
    var drawn = JSON.parse(box.querySelector("script").textContent), room = document.createElement("div");
    var readout = document.createElement("p"), last = 0;
    box.querySelector("details").open = false;
    readout.className = "readout"; readout.setAttribute("aria-live", "polite");
    box.prepend(room, readout);
    function redraw() {
      var width = box.clientWidth || 700, columns = width < NARROW ? 1 : drawn.columns, k;
      if (width === last) return;
      last = width; room.textContent = "";
      for (k = 0; k < drawn.panels.length; k += columns) {
        var row = document.createElement("div"), parts = drawn.panels.slice(k, k + columns);
        var all = parts.reduce(function (sum, part) { return sum + part.share; }, 0);
        if (parts.length < columns) all *= columns / parts.length;
        row.className = "panels"; room.append(row);
        parts.forEach(function (part) {
          var cell = document.createElement("div");
          row.append(cell);
          panel(cell, part, Math.floor(width * part.share / all), drawn.alt, readout);
        });
      }
    }
    window.addEventListener("resize", redraw);
    redraw();
  });

  var contents = document.querySelector("nav details");
  if (contents && window.innerWidth < 1200) contents.open = false;
  document.querySelectorAll(".waveform").forEach(function (box) {
    viewer(box, data[Number(box.dataset.place)]);
  });
})();
