// Interactive seismograms: drag to zoom, double click to see all, a cursor with values, switches
// for channels and motions. Data: <script id="waves">, no network.
(function () {
  "use strict";
  var data = JSON.parse(document.getElementById("waves").textContent);
  var COLOURS = { simulated: "#c2410c", recorded: "#1d4ed8" }, GAP = 14, LEFT = 52, BOTTOM = 26;

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
               values: samples(t.values), shown: true };
    });
    var names = traces.map(function (t) { return t.name; }).filter(function (n, k, all) {
      return all.indexOf(n) === k; });
    var off = {}, all = [Infinity, -Infinity], view, cursor = null, drag = null;
    traces.forEach(function (t) {
      all[0] = Math.min(all[0], t.start);
      all[1] = Math.max(all[1], t.start + t.dt * (t.values.length - 1));
    });
    view = all.slice();
    var canvas = document.createElement("canvas"), bar = document.createElement("div");
    var told = document.createElement("p"), pen = canvas.getContext("2d");
    bar.className = "switches"; told.className = "told";
    box.append(bar, canvas, told);
    names.concat(Object.keys(COLOURS).filter(function (kind) {
      return traces.some(function (t) { return t.kind === kind; }); })).forEach(function (key) {
      var label = document.createElement("label"), tick = document.createElement("input");
      tick.type = "checkbox"; tick.checked = true;
      tick.onchange = function () { off[key] = !tick.checked; draw(); };
      if (COLOURS[key]) label.style.color = COLOURS[key];
      label.append(tick, " " + key); bar.append(label);
    });
    var back = document.createElement("button");
    back.textContent = "whole record";
    back.onclick = function () { view = all.slice(); draw(); };
    bar.append(back);

    function size() { return { w: canvas.clientWidth, h: canvas.clientHeight }; }
    function rows() { return names.filter(function (n) { return !off[n]; }); }
    function toX(time, w) { return LEFT + (time - view[0]) / (view[1] - view[0]) * (w - LEFT - 8); }
    function toTime(x, w) { return view[0] + (x - LEFT) / (w - LEFT - 8) * (view[1] - view[0]); }

    function draw() {
      var ratio = window.devicePixelRatio || 1, list = rows(), s;
      canvas.style.height = Math.max(1, list.length) * 118 + BOTTOM + "px";
      s = size();
      canvas.width = s.w * ratio; canvas.height = s.h * ratio;
      pen.setTransform(ratio, 0, 0, ratio, 0, 0);
      pen.clearRect(0, 0, s.w, s.h);
      pen.font = "11px system-ui, sans-serif";
      var high = (s.h - BOTTOM) / Math.max(1, list.length);
      list.forEach(function (name, row) { panel(name, row * high, high - GAP, s.w); });
      var t = ticks(view[0], view[1], Math.max(3, s.w / 110));
      pen.fillStyle = "#444"; pen.textAlign = "center";
      t.at.forEach(function (at) { pen.fillText(at.toFixed(t.digits), toX(at, s.w), s.h - 12); });
      pen.textAlign = "right"; pen.fillText("s", s.w - 1, s.h - 1);
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

    function panel(name, top, height, w) {
      var shown = traces.filter(function (t) { return t.name === name && !off[t.kind]; }), peak = 0;
      shown.forEach(function (t) { peak = Math.max(peak, largest(t)); });
      peak = peak || 1;
      function toY(value) { return top + 4 + (height - 4) * (0.5 - 0.48 * value / peak); }
      var t = ticks(-peak, peak, 5);
      pen.textAlign = "right"; pen.lineWidth = 1;
      t.at.forEach(function (at) {
        pen.strokeStyle = Math.abs(at) < 1e-12 ? "#bbb" : "#eee"; pen.beginPath();
        pen.moveTo(LEFT, toY(at)); pen.lineTo(w - 8, toY(at)); pen.stroke();
        pen.fillStyle = "#666"; pen.fillText(at.toFixed(t.digits), LEFT - 4, toY(at) + 4);
      });
      pen.fillStyle = "#222"; pen.textAlign = "left";
      pen.fillText(name + "  mm/s", LEFT + 4, top + 12);
      pen.save(); pen.beginPath(); pen.rect(LEFT, top, w - LEFT - 8, height + 4); pen.clip();
      shown.forEach(function (trace) {
        var first = Math.max(0, Math.floor((view[0] - trace.start) / trace.dt) - 1), k;
        var last = Math.min(trace.values.length - 1,
                            Math.ceil((view[1] - trace.start) / trace.dt) + 1);
        pen.strokeStyle = COLOURS[trace.kind]; pen.lineWidth = 1.1; pen.beginPath();
        for (k = first; k <= last; k++)
          pen.lineTo(toX(trace.start + k * trace.dt, w), toY(trace.values[k] * trace.scale));
        pen.stroke();
      });
      pen.restore();
    }

    function largest(trace) {
      var first = Math.max(0, Math.floor((view[0] - trace.start) / trace.dt)), most = 0, k;
      var last = Math.min(trace.values.length - 1, Math.ceil((view[1] - trace.start) / trace.dt));
      for (k = first; k <= last; k++) most = Math.max(most, Math.abs(trace.values[k]));
      return most * trace.scale;
    }

    function say(w) {
      if (cursor === null) { told.textContent = "Drag to zoom, double click for the whole record."; return; }
      var time = toTime(cursor, w);
      told.textContent = time.toFixed(4) + " s: " + traces.filter(function (t) {
        return !off[t.name] && !off[t.kind]; }).map(function (t) {
        var k = Math.round((time - t.start) / t.dt), v = t.values[k];
        return t.name + " " + t.kind + " " + (v === undefined ? "–" : short(v * t.scale));
      }).join(", ") + " mm/s";
    }

    function where(event) {
      var x = event.clientX - canvas.getBoundingClientRect().left;
      return Math.min(size().w - 8, Math.max(LEFT, x));
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
    draw();
  }

  if (window.innerWidth < 1200) document.querySelector("nav details").open = false;
  document.querySelectorAll(".waveform").forEach(function (box) {
    viewer(box, data[Number(box.dataset.place)]);
  });
})();
