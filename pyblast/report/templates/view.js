// The view of a page (.view): a model that turns, drawn on a canvas by a depth buffer, without a
// graphics card and without network. Data are JSON inside the page; names enter as text only.
// Parallel projection: depth, values and the distance to the cutting plane are linear in a triangle.
(function () {
  "use strict";
  var GROUND = ["#cdb58c", "#8fa3ad", "#5b6570", "#a7b08a", "#b48a78", "#7a8fb0"];
  var MAPS = { ppv: ["#fff7dc", "#fbd277", "#f08a2c", "#c2410c", "#7c1d0a"],
               other: ["#440154", "#46327e", "#365c8d", "#277f8e", "#1fa187", "#4ac16d", "#a0da39", "#fde725"] };
  var PLANE = { fault: [185, 28, 28], joint: [71, 85, 105] }, RECEIVER = "#1d4ed8", REMOVABLE = [126, 34, 206], FAR = -1e30, PICK = 14;
  var SLOW = 70;  // ms of a picture, above which it is drawn coarser while it moves

  function rgb(hex) { return [1, 3, 5].map(function (k) { return parseInt(hex.slice(k, k + 2), 16); }); }

  function numbers(text, wide) {
    var raw = atob(text), bytes = new Uint8Array(raw.length), k;
    for (k = 0; k < raw.length; k++) bytes[k] = raw.charCodeAt(k);
    return wide ? new Uint32Array(bytes.buffer) : new Uint16Array(bytes.buffer);
  }

  function short(value) { return Number(value.toPrecision(3)).toString(); }

  // Colours of the levels of a field: bands at 1, 2, 5 on logarithmic scales, else sixteen steps.
  function colours(field, key) {
    var map = (MAPS[key] || MAPS.other).map(rgb), out = new Uint8Array(3 * 65536), band = new Uint8Array(65536), k, c;
    var edges = steps(field);
    for (k = 1; k < 65536; k++) {
      var value = valueOf(field, k), b = 0;
      while (b < edges.length && edges[b] <= value) b++;
      var share = Math.min(1, b / Math.max(1, edges.length)) * (map.length - 1), low = Math.min(map.length - 2, Math.floor(share));
      for (c = 0; c < 3; c++) out[3 * k + c] = map[low][c] * (low + 1 - share) + map[low + 1][c] * (share - low);
      band[k] = b + 1;
    }
    return { table: out, band: band, edges: edges };
  }

  function steps(field) {
    var out = [], power, k;
    if (!field.log) {
      for (k = 1; k < 10; k++) out.push(field.low + k * (field.high - field.low) / 10);
      return out;
    }
    for (power = Math.floor(Math.log10(field.low)); power <= Math.log10(field.high); power++)
      [1, 2, 5].forEach(function (m) {
        var v = m * Math.pow(10, power);
        if (v > field.low && v < field.high) out.push(v);
      });
    return out;
  }

  function valueOf(field, level) {
    if (!level) return null;
    var share = (level - 1) / 65534;
    return field.log ? field.low * Math.pow(field.high / field.low, share) : field.low + share * (field.high - field.low);
  }

  function decoded(scene) {
    var parts = scene.parts.map(function (part) {
      var points = numbers(part.points), xyz = new Float32Array(points.length), k;
      for (k = 0; k < points.length; k++) xyz[k] = scene.low[k % 3] + scene.step * points[k];
      var out = { name: part.name, kind: part.kind, told: part, xyz: xyz, triangles: numbers(part.triangles, part.wide),
                  ofPoint: {}, ofTriangle: {} };
      out.edges = edgesOf(out.triangles);
      Object.keys(part.of_point).forEach(function (key) { out.ofPoint[key] = numbers(part.of_point[key]); });
      Object.keys(part.of_triangle).forEach(function (key) { out.ofTriangle[key] = numbers(part.of_triangle[key]); });
      return out;
    });
    var low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
    parts.forEach(function (part) {
      part.xyz.forEach(function (v, k) { low[k % 3] = Math.min(low[k % 3], v); high[k % 3] = Math.max(high[k % 3], v); });
    });
    // What a box cuts off: a little beyond it stays, as its sides may be sides of the mesh.
    var clip = [[-Infinity, -Infinity, -Infinity], [Infinity, Infinity, Infinity]], edge = 1e-5 * Math.hypot(high[0] - low[0], high[1] - low[1], high[2] - low[2]);
    var whole = [low.slice(), high.slice()];
    if (scene.box) [0, 1, 2].forEach(function (k) {
      clip[0][k] = scene.box[k][0] - edge; clip[1][k] = scene.box[k][1] + edge;
      low[k] = Math.max(low[k], scene.box[k][0]); high[k] = Math.min(high[k], scene.box[k][1]);
    });
    var around = [low.slice(), high.slice()], far = Math.hypot(high[0] - low[0], high[1] - low[1]);
    scene.holes.map(function (h) { return h.collar; }).concat(Object.keys(scene.receivers).map(function (n) { return scene.receivers[n].position; })).forEach(function (at) {
      if ([0, 1].every(function (k) { return at[k] > low[k] - far && at[k] < high[k] + far; }))
        [0, 1, 2].forEach(function (k) { around[0][k] = Math.min(around[0][k], at[k]); around[1][k] = Math.max(around[1][k], at[k]); });
    });
    return { parts: parts, whole: whole, around: around, low: low, high: high, clip: clip, clipped: Boolean(scene.box) };
  }

  // Pairs of nodes of the edges that one triangle alone has.
  function edgesOf(triangles) {
    var seen = new Map(), n;
    for (n = 0; n < triangles.length; n++) {
      var i = triangles[n], j = triangles[n % 3 === 2 ? n - 2 : n + 1], key = Math.min(i, j) * 4294967296 + Math.max(i, j);
      seen.set(key, seen.has(key) ? null : [i, j]);
    }
    return [].concat.apply([], Array.from(seen.values()).filter(Boolean));
  }

  // Draw the parts into buffers of width x height; ground and planes have buffers of their own.
  function Renderer(model) {
    var W = 0, H = 0, front, plane;
    function layer() {
      return { z: new Float32Array(W * H), colour: new Uint8Array(3 * W * H), part: new Int16Array(W * H), level: new Uint16Array(W * H), band: new Uint8Array(W * H) };
    }
    function clear(l) { l.z.fill(FAR); l.part.fill(-1); l.level.fill(0); l.band.fill(0); }

    this.draw = function (w, h, camera, options) {
      if (w !== W || h !== H) { W = w; H = h; front = layer(); plane = layer(); }
      clear(front); clear(plane);
      model.parts.forEach(function (part, n) {
        if (!options.hidden[part.name]) raster(part, n, part.kind === "ground" ? front : plane, camera, options);
      });
      return { ground: front, planes: plane, width: W, height: H };
    };

    function raster(part, number, l, camera, options) {
      var xyz = part.xyz, count = xyz.length / 3, sx = new Float64Array(count), sy = new Float64Array(count), sz = new Float64Array(count);
      var a = camera.axes, ground = part.kind === "ground", cut = ground ? options.cut : null, low = model.clip[0], high = model.clip[1], k;
      for (k = 0; k < count; k++) {
        var dx = xyz[3 * k] - camera.at[0], dy = xyz[3 * k + 1] - camera.at[1], dz = xyz[3 * k + 2] - camera.at[2];
        sx[k] = W / 2 + camera.zoom * (a[0][0] * dx + a[0][1] * dy + a[0][2] * dz);
        sy[k] = H / 2 - camera.zoom * (a[1][0] * dx + a[1][1] * dy + a[1][2] * dz);
        sz[k] = a[2][0] * dx + a[2][1] * dy + a[2][2] * dz;
      }
      var key = options.field, scale = options.scales[key], points = part.ofPoint[options.values || key], faces = part.ofTriangle[key], groups = part.ofTriangle.group;
      if (!scale) { points = null; faces = null; }
      var t = part.triangles, n;
      for (n = 0; n < t.length; n += 3) {
        var i = t[n], j = t[n + 1], m = t[n + 2];
        var x0 = sx[i], y0 = sy[i], x1 = sx[j], y1 = sy[j], x2 = sx[m], y2 = sy[m];
        var area = (x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0);
        if (Math.abs(area) < 1e-9) continue;
        var back = ground && area > 0;  // seen from inside: y points down
        if (back && !cut && !model.clipped) continue;
        var left = Math.max(0, Math.ceil(Math.min(x0, x1, x2) - 0.5)), right = Math.min(W - 1, Math.floor(Math.max(x0, x1, x2) - 0.5));
        var first = Math.max(0, Math.ceil(Math.min(y0, y1, y2) - 0.5)), last = Math.min(H - 1, Math.floor(Math.max(y0, y1, y2) - 0.5));
        if (left > right || first > last) continue;
        var shade = back ? 0.94 : lit(xyz, i, j, m), base = baseOf(part, groups ? groups[n / 3] : 0, n / 3, back ? "material" : key);  // blocks end at joints, which the cut does not know
        var v0 = points ? points[i] : 0, v1 = points ? points[j] : 0, v2 = points ? points[m] : 0, known = points ? v0 && v1 && v2 : false, fixed = faces ? faces[n / 3] : 0;
        for (var py = first; py <= last; py++) {
          dy = py + 0.5;
          var w0 = ((x2 - x1) * (dy - y1) - (y2 - y1) * (left + 0.5 - x1)) / area, w1 = ((x0 - x2) * (dy - y2) - (y0 - y2) * (left + 0.5 - x2)) / area;
          var s0 = -(y2 - y1) / area, s1 = -(y0 - y2) / area;
          for (var px = left; px <= right; px++, w0 += s0, w1 += s1) {
            var w2 = 1 - w0 - w1;
            if (w0 < -1e-6 || w1 < -1e-6 || w2 < -1e-6) continue;
            var depth = w0 * sz[i] + w1 * sz[j] + w2 * sz[m] + (back ? camera.size * 1e-5 : 0), at = py * W + px;
            if (depth <= l.z[at]) continue;
            var u = (px + 0.5 - W / 2) / camera.zoom, v = (H / 2 - dy) / camera.zoom, x = camera.at[0] + u * a[0][0] + v * a[1][0] + depth * a[2][0], y = camera.at[1] + u * a[0][1] + v * a[1][1] + depth * a[2][1];
            if (x < low[0] || x > high[0] || y < low[1] || y > high[1] || cut && cut.normal[0] * x + cut.normal[1] * y > cut.at) continue;
            var z = camera.at[2] + u * a[0][2] + v * a[1][2] + depth * a[2][2];
            if (z < low[2] || z > high[2]) continue;
            l.z[at] = depth; l.part[at] = number;
            var level = back ? 0 : known ? Math.round(w0 * v0 + w1 * v1 + w2 * v2) : fixed, c = 3 * at;
            l.level[at] = level;
            if (level && scale) {
              l.colour[c] = scale.table[3 * level] * shade; l.colour[c + 1] = scale.table[3 * level + 1] * shade; l.colour[c + 2] = scale.table[3 * level + 2] * shade;
              l.band[at] = scale.band[level];
            } else {
              l.colour[c] = base[0] * shade; l.colour[c + 1] = base[1] * shade; l.colour[c + 2] = base[2] * shade;
              l.band[at] = back ? 254 : 0;
            }
          }
        }
      }
    }

    function lit(xyz, i, j, m) {
      var ax = xyz[3 * j] - xyz[3 * i], ay = xyz[3 * j + 1] - xyz[3 * i + 1], az = xyz[3 * j + 2] - xyz[3 * i + 2];
      var bx = xyz[3 * m] - xyz[3 * i], by = xyz[3 * m + 1] - xyz[3 * i + 1], bz = xyz[3 * m + 2] - xyz[3 * i + 2];
      var nx = ay * bz - az * by, ny = az * bx - ax * bz, nz = ax * by - ay * bx, size = Math.sqrt(nx * nx + ny * ny + nz * nz) || 1;
      return 0.62 + 0.38 * Math.abs(-0.35 * nx - 0.5 * ny + 0.79 * nz) / size;
    }

    function baseOf(part, group, triangle, key) {
      if (part.kind !== "ground") return PLANE[part.kind];
      var base = rgb(GROUND[group % GROUND.length]);
      if (key === "removable" && part.ofTriangle.removable[triangle]) return REMOVABLE;
      if (key !== "block") return base;
      var turn = Math.sin(12.9898 * (part.ofTriangle.block[triangle] + 1)) * 43758.5453, shade = 0.78 + 0.4 * (turn - Math.floor(turn));
      return base.map(function (v) { return Math.min(255, v * shade); });
    }
  }

  function start(box) {
    var scene = JSON.parse(box.querySelector("script").textContent), model = decoded(scene), renderer = new Renderer(model);
    var size = Math.hypot(model.high[0] - model.low[0], model.high[1] - model.low[1], model.high[2] - model.low[2]) || 1;
    var middle = [0, 1, 2].map(function (k) { return 0.5 * (model.around[0][k] + model.around[1][k]); });
    var view = { yaw: -0.6, pitch: 0.5, zoom: 1, at: middle.slice() }, frame = null, playing = null, moving = false, coarse = 1, buffers = null, marks = [], marked = -1;
    var scales = {};
    Object.keys(scene.fields).forEach(function (key) { scales[key] = colours(scene.fields[key], key); });
    var canvas = document.createElement("canvas"), pen = canvas.getContext("2d"), bar = document.createElement("div"), readout = document.createElement("p"), legend = document.createElement("div");
    box.querySelector("details").open = false;
    bar.className = "switches"; readout.className = "readout"; legend.className = "legend";
    readout.setAttribute("aria-live", "polite");
    canvas.tabIndex = 0; canvas.setAttribute("role", "application");
    canvas.setAttribute("aria-label", scene.title + ": model in three dimensions. Arrow keys turn, plus and minus zoom, n names the next thing, c cuts, brackets move the cut.");
    box.prepend(bar, legend, canvas, readout);

    function choice(words, options, change) {
      var label = document.createElement("label"), select = document.createElement("select");
      options.forEach(function (one) {
        var option = document.createElement("option");
        option.value = one[0]; option.textContent = one[1]; select.append(option);
      });
      select.onchange = function () { change(select.value); draw(); };
      label.append(words + " ", select); bar.append(label);
      return select;
    }
    function slider(words, value, change) {
      var label = document.createElement("label"), input = document.createElement("input");
      input.type = "range"; input.min = 0; input.max = 100; input.value = value;
      input.oninput = function () { change(Number(input.value) / 100); draw(); };
      label.append(words + " ", input); bar.append(label);
      return input;
    }
    var fields = [["material", "material"]];
    if (model.parts[0].ofTriangle.block && model.parts[0].ofTriangle.block.some(function (b) { return b > 0; })) fields.push(["block", "blocks"]);
    if (model.parts[0].ofTriangle.removable && model.parts[0].ofTriangle.removable.some(Boolean)) fields.push(["removable", "removable blocks"]);
    Object.keys(scene.fields).forEach(function (key) { fields.push([key, scene.fields[key].label + (scene.fields[key].unit ? " [" + scene.fields[key].unit + "]" : "")]); });
    var field = choice("colour", fields, function () { stop(); });
    field.className = "field";
    field.value = scene.fields.ppv ? "ppv" : "material";
    var looks = [["", "look …"], ["above", "from above"], ["south", "from the south"], ["east", "from the east"], ["corner", "from a corner"]];
    if (scene.wall !== null) looks.push(["wall", "at the wall"], ["along", "along the wall"]);
    model.parts.forEach(function (part, n) { if (part.kind !== "ground") looks.push(["plane" + n, "along " + part.name]); });
    var look = choice("", looks, function (value) { turnTo(value); look.value = ""; });
    look.setAttribute("aria-label", "look from");
    var cut = choice("cut", [["", "not"], ["east", "across east"], ["north", "across north"], ["seen", "facing me"]], function (value) {
      cutting = value ? { normal: { east: [1, 0], north: [0, -1], seen: [-Math.sin(view.yaw), -Math.cos(view.yaw)] }[value] } : null;
    });
    var hidden = {}, many = 0;
    model.parts.forEach(function (part) { if (part.kind === "joint") many += part.triangles.length / 3; });
    function hide(value) {
      model.parts.forEach(function (part) { hidden[part.name] = part.kind !== "ground" && (value === "none" || value === "faults" && part.kind === "joint"); });
    }
    if (many) {
      var planes = choice("planes", [["all", "all"], ["faults", "faults alone"], ["none", "none"]], hide);
      planes.className = "planes";
      planes.value = many > 2000 ? "faults" : "all";  // sets before a cut would hide it
      hide(planes.value);
    }
    var cutting = null, share = 0.5, solid = 1;
    cut.className = "cut";
    var cutAt = slider("at", 50, function (v) { share = v; });
    cutAt.setAttribute("aria-label", "place of the cut");
    slider("ground", 100, function (v) { solid = v; }).setAttribute("aria-label", "how solid the ground is");
    if (scene.times.length) {
      var play = document.createElement("button");
      play.textContent = "play the motion";
      play.onclick = function () { if (playing) { stop(); draw(); return; } field.value = "speed"; frame = 0; step(); };
      bar.append(play);
    }
    if (scene.fields.speed) field.addEventListener("change", function () { frame = field.value === "speed" ? 0 : null; draw(); });
    function step() {
      draw(); playing = setTimeout(function () { frame = (frame + 1) % scene.times.length; step(); }, 180);
    }
    function stop() { clearTimeout(playing); playing = null; frame = field.value === "speed" ? 0 : null; }

    function turnTo(value) {
      var planes = value.slice(0, 5) === "plane" ? model.parts[Number(value.slice(5))].told : null, rad = Math.PI / 180;
      if (value === "above") { view.yaw = 0; view.pitch = Math.PI / 2; }
      if (value === "south") { view.yaw = 0; view.pitch = 0; }
      if (value === "east") { view.yaw = -Math.PI / 2; view.pitch = 0; }
      if (value === "corner") { view.yaw = -0.6; view.pitch = 0.5; }
      if (value === "wall") { view.yaw = scene.wall * rad + Math.PI; view.pitch = 0.25; }
      if (value === "along") { view.yaw = scene.wall * rad + Math.PI / 2; view.pitch = 0.1; }
      if (planes) { view.yaw = (planes.direction + 90) * rad; view.pitch = 0.05; }
      view.at = middle.slice(); view.zoom = 1;
    }

    // Rows: right, up, towards the eye. Yaw is the bearing that one looks to.
    function axes() {
      var s = Math.sin(view.yaw), c = Math.cos(view.yaw), p = Math.sin(view.pitch), q = Math.cos(view.pitch);
      return [[c, -s, 0], [s * p, c * p, q], [-s * q, -c * q, p]];
    }
    function camera(width, height) {
      var b = model.around, wide = Math.hypot(b[1][0] - b[0][0], b[1][1] - b[0][1]), tall = 0.5 * wide + 0.9 * (b[1][2] - b[0][2]);
      return { axes: axes(), at: view.at, zoom: 0.94 * view.zoom * Math.min(width / wide, height / tall), size: size };
    }
    function toScreen(at, cam, width, height) {
      var d = [at[0] - cam.at[0], at[1] - cam.at[1], at[2] - cam.at[2]];
      var s = cam.axes.map(function (row) { return row[0] * d[0] + row[1] * d[1] + row[2] * d[2]; });
      return [width / 2 + cam.zoom * s[0], height / 2 - cam.zoom * s[1], s[2]];
    }

    function cutNow() {
      if (!cutting) return null;
      var n = cutting.normal, all = [[0, 0], [0, 1], [1, 0], [1, 1]].map(function (k) {
        return n[0] * (k[0] ? model.high[0] : model.low[0]) + n[1] * (k[1] ? model.high[1] : model.low[1]); });
      var low = Math.min.apply(null, all), high = Math.max.apply(null, all);
      return { normal: n, at: low + share * (high - low) };
    }

    function draw() {
      var begun = performance.now(), width = canvas.clientWidth || 600, height = Math.round(Math.max(280, Math.min(0.62 * width, 620)));
      if (width < 500) height = Math.round(0.95 * width);
      canvas.style.height = height + "px";
      var ratio = moving ? coarse : Math.min(2, Math.max(1.5, window.devicePixelRatio || 1)), w = Math.round(width * ratio), h = Math.round(height * ratio);
      var cam = camera(w, h), cutter = cutNow();
      buffers = renderer.draw(w, h, cam, { hidden: hidden, field: field.value, values: field.value === "speed" ? "speed" + (frame || 0) : null, scales: scales, cut: cutter });
      canvas.width = w; canvas.height = h;
      var image = pen.createImageData(w, h), out = image.data, g = buffers.ground, p = buffers.planes, at;
      if (cutter || model.clipped) cap(g, cam, cutter, w, h);
      for (at = 0; at < w * h; at++) {
        var c = 3 * at, o = 4 * at, hasPlane = p.part[at] >= 0, hasGround = g.part[at] >= 0, k;
        out[o] = out[o + 1] = out[o + 2] = out[o + 3] = 255;
        if (hasPlane) for (k = 0; k < 3; k++) out[o + k] = p.colour[c + k];
        if (hasGround && (!hasPlane || g.z[at] > p.z[at] - 1e-4 * size)) {
          var line = at > w && (g.band[at] !== g.band[at - 1] && g.part[at - 1] >= 0 || g.band[at] !== g.band[at - w] && g.part[at - w] >= 0) ? 0.55 : 1;
          if (hasPlane && g.z[at] < p.z[at] + 1e-3 * size) continue;  // a plane that lies in the ground's surface
          for (k = 0; k < 3; k++) out[o + k] = solid * line * g.colour[c + k] + (1 - solid) * out[o + k];
        }
      }
      traces(out, cam, w, h, ratio);
      pen.putImageData(image, 0, 0);
      overlay(cam, w, h, ratio);
      keys();
      canvas.dataset.ms = Math.round(performance.now() - begun);
      if (moving) coarse = performance.now() - begun > SLOW ? Math.max(0.5, 0.7 * coarse) : coarse;
    }

    // Where the first face within the box and behind the cut is seen from inside, the cut or a side of the
    // box is seen: give it its depth and shade.
    function cap(g, cam, cutter, w, h) {
      var a = cam.axes, x, y, planes = [];
      [0, 1, 2].forEach(function (k) {
        var n = [0, 0, 0];
        n[k] = a[2][k] > 0 ? 1 : -1;
        planes.push({ normal: n, at: n[k] * model.clip[a[2][k] > 0 ? 1 : 0][k], shade: [0.86, 0.8, 1][k] });
      });
      if (cutter) planes.push({ normal: [cutter.normal[0], cutter.normal[1], 0], at: cutter.at, shade: 1 });
      planes = planes.filter(function (p) {
        p.slope = p.normal[0] * a[2][0] + p.normal[1] * a[2][1] + p.normal[2] * a[2][2];
        return p.slope > 1e-6 && isFinite(p.at);
      });
      for (y = 0; y < h; y++) for (x = 0; x < w; x++) {
        var at = y * w + x;
        if (g.band[at] !== 254) continue;
        var u = (x + 0.5 - w / 2) / cam.zoom, v = (h / 2 - y - 0.5) / cam.zoom;
        var p0 = cam.at[0] + u * a[0][0] + v * a[1][0], p1 = cam.at[1] + u * a[0][1] + v * a[1][1], p2 = cam.at[2] + u * a[0][2] + v * a[1][2], entry = Infinity, shade = 1, k;
        for (k = 0; k < planes.length; k++) {
          var p = planes[k], z = (p.at - p.normal[0] * p0 - p.normal[1] * p1 - p.normal[2] * p2) / p.slope;
          if (z < entry) { entry = z; shade = p.shade; }
        }
        if (entry === Infinity) continue;
        g.z[at] = entry;
        for (k = 0; k < 3; k++) g.colour[3 * at + k] *= shade;
      }
    }

    // Edges of planes, where neither ground nor another plane hides them: their traces.
    function traces(out, cam, w, h, ratio) {
      model.parts.forEach(function (part) {
        if (part.kind === "ground" || hidden[part.name]) return;
        var thick = Math.max(1, Math.round((part.kind === "fault" ? 1.4 : 0.7) * ratio)), colour = PLANE[part.kind], k;
        for (k = 0; k < part.edges.length; k += 2) {
          var ends = [part.edges[k], part.edges[k + 1]].map(function (n) { return toScreen([part.xyz[3 * n], part.xyz[3 * n + 1], part.xyz[3 * n + 2]], cam, w, h); });
          var a = ends[0], b = ends[1], count = Math.ceil(Math.max(Math.abs(a[0] - b[0]), Math.abs(a[1] - b[1]))) || 1, s;
          for (s = 0; s <= count; s++) dot(out, a[0] + (b[0] - a[0]) * s / count, a[1] + (b[1] - a[1]) * s / count, a[2] + (b[2] - a[2]) * s / count, w, h, thick, colour);
        }
      });
    }
    function dot(out, x, y, z, w, h, thick, colour) {
      var px = Math.round(x), py = Math.round(y), i, j, c;
      if (px < thick || py < thick || px >= w - thick || py >= h - thick) return;
      var at = py * w + px, g = buffers.ground;
      if (solid > 0.5 && g.part[at] >= 0 && g.z[at] > z + 4e-3 * size && near(g, at, w, z)) return;
      for (i = 0; i < thick; i++) for (j = 0; j < thick; j++) {
        var o = 4 * (at + i * w + j);
        for (c = 0; c < 3; c++) out[o + c] = colour[c];
      }
    }
    function near(g, at, w, z) {  // hidden in all of the neighbourhood, too
      return [-2, 2, -2 * w, 2 * w].every(function (k) { return g.part[at + k] < 0 || g.z[at + k] > z + 4e-3 * size; });
    }

    function behind(s, w, h) {
      var x = Math.round(s[0]), y = Math.round(s[1]);
      if (x < 0 || y < 0 || x >= w || y >= h) return false;
      var at = y * w + x;
      return solid > 0.95 && buffers.ground.part[at] >= 0 && buffers.ground.z[at] > s[2] + 0.006 * size;
    }

    function overlay(cam, w, h, ratio) {
      marks = [];
      var numbered = [];
      pen.font = 11 * ratio + "px system-ui, sans-serif"; pen.lineCap = "round";
      scene.holes.forEach(function (hole) {
        var from = toScreen(hole.collar, cam, w, h), to = toScreen(hole.toe, cam, w, h), colour = "hsl(" + (250 - 200 * hole.late) + ",75%,38%)";
        pen.globalAlpha = behind([0.5 * (from[0] + to[0]), 0.5 * (from[1] + to[1]), 0.5 * (from[2] + to[2])], w, h) ? 0.45 : 1;
        var column = hole.column.map(function (at) { return toScreen(at, cam, w, h); });
        pen.strokeStyle = "#fff"; pen.lineWidth = 5 * ratio; line(from, to);
        pen.strokeStyle = colour; pen.lineWidth = 1.2 * ratio; line(from, to);
        pen.lineWidth = 3.5 * ratio; line(column[0], column[1]);
        pen.globalAlpha = behind(from, w, h) ? 0.45 : 1;
        pen.fillStyle = colour; pen.beginPath(); pen.arc(from[0], from[1], 3.5 * ratio, 0, 7); pen.fill();
        if (!numbered.some(function (at) { return Math.hypot(at[0] - from[0], at[1] - from[1]) < 13 * ratio; })) {
          numbered.push(from); write(String(hole.order), from[0] + 5 * ratio, from[1] - 4 * ratio, ratio);
        }
        marks.push({ at: from, words: "hole " + hole.name + ", number " + hole.order + " to fire", rows: hole.rows, place: hole.collar });
      });
      scene.sources.forEach(function (at, n) {
        var s = toScreen(at, cam, w, h), k;
        pen.globalAlpha = behind(s, w, h) ? 0.45 : 1; pen.strokeStyle = "#b91c1c"; pen.lineWidth = 2 * ratio;
        for (k = 0; k < 4; k++) {
          var dx = 7 * ratio * Math.cos(k * Math.PI / 4), dy = 7 * ratio * Math.sin(k * Math.PI / 4);
          line([s[0] - dx, s[1] - dy], [s[0] + dx, s[1] + dy]);
        }
        marks.push({ at: s, words: "source " + (n + 1), rows: [], place: at });
      });
      Object.keys(scene.receivers).forEach(function (name) {
        var r = scene.receivers[name], s = toScreen(r.position, cam, w, h);
        pen.globalAlpha = behind(s, w, h) ? 0.4 : 1;
        if (r.azimuth !== null && r.azimuth !== undefined) {
          var long = 0.06 * size / view.zoom, tip = toScreen([r.position[0] + long * Math.sin(r.azimuth), r.position[1] + long * Math.cos(r.azimuth), r.position[2]], cam, w, h);
          pen.strokeStyle = RECEIVER; pen.lineWidth = 2 * ratio; line(s, tip);
        }
        pen.fillStyle = r.over ? "#b91c1c" : RECEIVER; pen.strokeStyle = "#fff"; pen.lineWidth = 1.5 * ratio;
        pen.beginPath(); pen.moveTo(s[0], s[1]); pen.lineTo(s[0] - 6 * ratio, s[1] - 11 * ratio); pen.lineTo(s[0] + 6 * ratio, s[1] - 11 * ratio); pen.closePath(); pen.fill(); pen.stroke();
        write(name, s[0] + 8 * ratio, s[1] - 8 * ratio, ratio);
        marks.push({ at: s, words: "receiver " + name, rows: r.rows, place: r.position });
      });
      pen.globalAlpha = 1;
      model.parts.forEach(function (part) { if (part.kind !== "ground" && !hidden[part.name]) label(part, cam, w, h, ratio); });
      compass(cam, w, h, ratio);
      if (frame !== null && scene.times.length) { pen.font = 14 * ratio + "px system-ui, sans-serif"; write(scene.times[frame].toFixed(3) + " s", 12 * ratio, 22 * ratio, ratio); }
    }
    function line(a, b) { pen.beginPath(); pen.moveTo(a[0], a[1]); pen.lineTo(b[0], b[1]); pen.stroke(); }
    function write(text, x, y, ratio) {
      pen.strokeStyle = "rgba(255,255,255,.85)"; pen.lineWidth = 3 * ratio; pen.strokeText(text, x, y);
      pen.fillStyle = "#111"; pen.fillText(text, x, y);
    }
    function label(part, cam, w, h, ratio) {
      var best = 0, k;
      if (part.kind === "joint" && part.told.area < 0.02 * size * size) return;
      for (k = 0; k < part.xyz.length; k += 3) if (part.xyz[k + 2] > part.xyz[best + 2] || part.xyz[k + 2] > part.xyz[best + 2] - 1e-3 * size && part.xyz[k + 1] > part.xyz[best + 1]) best = k;
      var s = toScreen([part.xyz[best], part.xyz[best + 1], part.xyz[best + 2]], cam, w, h);
      if (part.kind === "fault" || !behind(s, w, h)) write(part.name, s[0] + 6 * ratio, s[1] - 6 * ratio, ratio);
    }
    function compass(cam, w, h, ratio) {
      var x = w - 42 * ratio, y = h - 40 * ratio;
      [["E", 0], ["N", 1], ["up", 2]].forEach(function (one) {
        var dx = cam.axes[0][one[1]] * 24 * ratio, dy = -cam.axes[1][one[1]] * 24 * ratio;
        pen.strokeStyle = "#333"; pen.lineWidth = 1.5 * ratio; line([x, y], [x + dx, y + dy]);
        if (Math.hypot(dx, dy) > 6 * ratio) write(one[0], x + 1.3 * dx - 4 * ratio, y + 1.3 * dy + 4 * ratio, ratio);
      });
      var metres = Math.pow(10, Math.floor(Math.log10(0.3 * w / cam.zoom)));
      [5, 2].some(function (m) { if (m * metres * cam.zoom < 0.3 * w) { metres *= m; return true; } return false; });
      pen.strokeStyle = "#111"; pen.lineWidth = 2 * ratio; line([14 * ratio, h - 14 * ratio], [14 * ratio + metres * cam.zoom, h - 14 * ratio]);
      pen.font = 11 * ratio + "px system-ui, sans-serif"; write(metres + " m", 14 * ratio, h - 20 * ratio, ratio);
    }

    function keys() {
      legend.textContent = "";
      function one(colour, text) {
        var span = document.createElement("span"), sign = document.createElement("b");
        sign.className = "swatch"; sign.style.background = colour; span.append(sign, text); legend.append(span);
      }
      var key = field.value;
      if (scales[key]) {
        var s = scales[key], edges = [scene.fields[key].low].concat(s.edges), kept = edges.filter(function (_, n) { return n % Math.ceil(edges.length / 9) === 0; });
        kept.forEach(function (edge) {
          var k = 1; while (k < 65535 && valueOf(scene.fields[key], k) < edge * (1 + 1e-9)) k += 16;
          one("rgb(" + [0, 1, 2].map(function (c) { return s.table[3 * Math.min(65535, k) + c]; }).join(",") + ")", "from " + short(edge));
        });
        legend.append(scene.fields[key].unit + (scene.fields[key].unit ? ", " : "") + "up to " + short(scene.fields[key].high));
      } else scene.groups.forEach(function (name, n) { one(GROUND[n % GROUND.length], name); });
      if (key === "removable") one("rgb(" + REMOVABLE.join(",") + ")", "could move out past its joints");
      ["fault", "joint"].forEach(function (kind) {
        if (model.parts.some(function (part) { return part.kind === kind; })) one("rgb(" + PLANE[kind].join(",") + ")", kind);
      });
    }

    function tell(x, y) {
      var ratio = canvas.width / canvas.clientWidth, best = null, least = PICK;
      marks.forEach(function (mark) {
        var far = Math.hypot(mark.at[0] / ratio - x, mark.at[1] / ratio - y);
        if (far < least) { least = far; best = mark; }
      });
      if (best) { name(best); return; }
      var w = buffers.width, h = buffers.height, cam = camera(w, h), px = Math.floor(x * ratio), py = Math.floor(y * ratio), at = py * w + px;
      var g = buffers.ground, p = buffers.planes, l = p.part[at] >= 0 && (g.part[at] < 0 || solid < 0.5 || p.z[at] > g.z[at] - 1e-3 * size) ? p : g;
      if (l.part[at] < 0) { readout.textContent = "Nothing is there."; return; }
      var part = model.parts[l.part[at]], a = cam.axes, u = [(px + 0.5 - w / 2) / cam.zoom, (h / 2 - py - 0.5) / cam.zoom, l.z[at]];
      var place = [0, 1, 2].map(function (k) { return cam.at[k] + u[0] * a[0][k] + u[1] * a[1][k] + u[2] * a[2][k]; });
      var words = [(part.kind === "ground" ? "" : part.kind + " ") + part.name + " at " + places(place)], key = field.value, value = scene.fields[key] && valueOf(scene.fields[key], l.level[at]);
      if (value !== null && value !== undefined) words.push(scene.fields[key].label + " " + short(value) + " " + scene.fields[key].unit);
      var side = part.kind === "ground" && sideAt(place);
      if (side) words.push(side);
      if (part.told.dip !== undefined) words.push("dip " + Math.round(part.told.dip) + "°, dip direction " + Math.round(part.told.direction) + "°");
      if (part.told.largest_slip !== undefined) words.push("largest slip " + short(part.told.largest_slip) + " mm");
      readout.textContent = words.join("; ");
    }
    function sideAt(at) {
      var near = 2e-3 * size, found = [["west", 0, 0], ["east", 1, 0], ["south", 0, 1], ["north", 1, 1], ["bottom", 0, 2]].filter(function (s) {
        return Math.abs(at[s[2]] - (s[1] ? model.high : model.low)[s[2]]) < near;
      });
      if (found.length !== 1) return null;
      var k = found[0][2], gap = Math.abs(model.whole[found[0][1]][k] - (found[0][1] ? model.high : model.low)[k]);
      return found[0][0] + " side: " + (gap > near ? "the mesh goes on beyond it" : scene.sides[found[0][0]] || "free");
    }
    function places(at) { return "east " + at[0].toFixed(1) + ", north " + at[1].toFixed(1) + ", height " + at[2].toFixed(1) + " m"; }
    function name(mark) {
      readout.textContent = mark.words + " at " + places(mark.place) + mark.rows.map(function (row) { return "; " + row[0] + " " + row[1]; }).join("");
    }

    var fingers = {}, before = null, still = null, pressed = null;
    function spread() {
      var all = Object.keys(fingers).map(function (k) { return fingers[k]; });
      return { x: all.reduce(function (s, f) { return s + f[0]; }, 0) / all.length, y: all.reduce(function (s, f) { return s + f[1]; }, 0) / all.length,
               apart: all.length > 1 ? Math.hypot(all[0][0] - all[1][0], all[0][1] - all[1][1]) : 0, count: all.length };
    }
    function pan(dx, dy) {
      var a = axes(), zoom = camera(canvas.clientWidth, canvas.clientHeight).zoom, k;
      for (k = 0; k < 3; k++) view.at[k] -= (dx * a[0][k] - dy * a[1][k]) / zoom;
    }
    function turn(dx, dy) {
      view.yaw += dx; view.pitch = Math.max(-0.6, Math.min(Math.PI / 2, view.pitch + dy));
    }
    function settle() { clearTimeout(still); still = setTimeout(function () { moving = false; draw(); }, 160); }
    function soon() { if (!soon.asked) { soon.asked = true; requestAnimationFrame(function () { soon.asked = false; moving = true; draw(); settle(); }); } }
    canvas.onpointerdown = function (event) {
      fingers[event.pointerId] = [event.clientX, event.clientY]; canvas.setPointerCapture(event.pointerId);
      before = spread(); pressed = [event.clientX, event.clientY]; canvas.focus({ preventScroll: true });
    };
    canvas.onpointermove = function (event) {
      if (!fingers[event.pointerId]) return;
      fingers[event.pointerId] = [event.clientX, event.clientY];
      var now = spread();
      if (now.count > 1) { pan(now.x - before.x, now.y - before.y); view.zoom *= now.apart / (before.apart || now.apart); }
      else if (event.shiftKey || event.buttons === 2) pan(now.x - before.x, now.y - before.y);
      else turn(0.008 * (now.x - before.x), 0.008 * (now.y - before.y));
      before = now; soon();
    };
    canvas.onpointerup = canvas.onpointercancel = function (event) {
      var place = canvas.getBoundingClientRect();
      delete fingers[event.pointerId]; before = spread();
      if (pressed && event.type === "pointerup" && Math.hypot(event.clientX - pressed[0], event.clientY - pressed[1]) < 5) tell(event.clientX - place.left, event.clientY - place.top);
      pressed = null;
    };
    canvas.oncontextmenu = function (event) { event.preventDefault(); };
    canvas.onwheel = function (event) {
      if (document.activeElement !== canvas) return;  // a page that is scrolled goes on
      event.preventDefault(); view.zoom *= Math.exp(-0.0012 * event.deltaY); soon();
    };
    canvas.onkeydown = function (event) {
      var side = { ArrowLeft: [1, 0], ArrowRight: [-1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[event.key], step = 30;
      if (side && event.shiftKey) pan(step * side[0], step * side[1]);
      else if (side) turn(-0.1 * side[0], 0.1 * side[1]);
      else if (event.key === "+" || event.key === "=") view.zoom *= 1.2;
      else if (event.key === "-") view.zoom /= 1.2;
      else if (event.key === "c") { cut.selectedIndex = (cut.selectedIndex + 1) % cut.options.length; cut.onchange(); }
      else if (event.key === "[" || event.key === "]") { share = Math.max(0, Math.min(1, share + (event.key === "]" ? 0.05 : -0.05))); cutAt.value = 100 * share; }
      else if (event.key === "n" && marks.length) { marked = (marked + 1) % marks.length; name(marks[marked]); return; }
      else return;
      event.preventDefault(); soon();
    };
    window.addEventListener("resize", draw);
    readout.textContent = "Drag to turn, shift and drag to move, click for a name and numbers; wheel (after a click) or two fingers zoom.";
    draw();
  }

  document.querySelectorAll(".view").forEach(start);
})();
