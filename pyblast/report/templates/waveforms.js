// Seismograms beside their amplitude spectra: drag to zoom, double click to see all, a cursor with
// values, switches for channels and motions. Data: <script id="waves">, no network.
(function () {
  "use strict";
  var data = JSON.parse(document.getElementById("waves").textContent);
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

  var contents = document.querySelector("nav details");
  if (contents && window.innerWidth < 1200) contents.open = false;
  document.querySelectorAll(".waveform").forEach(function (box) {
    viewer(box, data[Number(box.dataset.place)]);
  });
})();
