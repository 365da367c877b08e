// The view of a page (.view): a model that turns, drawn by three.js (THREE of three.min.js) without
// network. Data are JSON inside the page; names enter as text only. Places count from scene.low.
(function () {
  "use strict";
  var GROUND = ["#cdb58c", "#8fa3ad", "#5b6570", "#a7b08a", "#b48a78", "#7a8fb0"];
  var HEAT = ["#fff7dc", "#fbd277", "#f08a2c", "#c2410c", "#7c1d0a"];
  var MAPS = { ppv: HEAT, share: HEAT, misfit: HEAT,
               other: ["#440154", "#46327e", "#365c8d", "#277f8e", "#1fa187", "#4ac16d", "#a0da39", "#fde725"] };
  var PLANE = { fault: [185, 28, 28], joint: [71, 85, 105], named: [192, 38, 211] }, KIND = { fault: "fault", joint: "joint", named: "joint named by the diagnosis" }, RECEIVER = "#1d4ed8", OVER = "#b91c1c", REMOVABLE = [126, 34, 206], WHITE = [255, 255, 255];
  var PICK = 14, TEXELS = 1024, FAINT = 0.5, APART = 13, FAR = 1e9;  // px; of a colour map; of what is hidden; px between labels; m

  function rgb(hex) { return [1, 3, 5].map(function (k) { return parseInt(hex.slice(k, k + 2), 16); }); }
  function css(colour) { return "rgb(" + colour.join(",") + ")"; }
  function short(value) { return Number(value.toPrecision(3)).toString(); }
  function numbers(text, wide) {
    var raw = atob(text), bytes = new Uint8Array(raw.length), k;
    for (k = 0; k < raw.length; k++) bytes[k] = raw.charCodeAt(k);
    return wide ? new Uint32Array(bytes.buffer) : new Uint16Array(bytes.buffer);
  }

  // Colours of a field: bands at 1, 2, 5 on logarithmic scales, else ten steps.
  function colours(field, key) {
    var map = (MAPS[key] || MAPS.other).map(rgb), edges = steps(field), data = new Uint8Array(4 * TEXELS), k;
    function of(value) {
      var band = edges.filter(function (edge) { return edge <= value; }).length;
      var share = Math.min(1, band / Math.max(1, edges.length)) * (map.length - 1), low = Math.min(map.length - 2, Math.floor(share));
      return [0, 1, 2].map(function (c) { return Math.round(map[low][c] * (low + 1 - share) + map[low + 1][c] * (share - low)); });
    }
    for (k = 0; k < TEXELS; k++) data.set((k ? of(valueOf(field, (k - 1) / (TEXELS - 2))) : WHITE).concat(255), 4 * k);
    var texture = new THREE.DataTexture(data, TEXELS, 1);
    texture.needsUpdate = true;
    return { edges: edges, of: of, texture: texture };
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
  function valueOf(field, share) {
    return field.log ? field.low * Math.pow(field.high / field.low, share) : field.low + share * (field.high - field.low);
  }
  // Place of a level in a colour map, whose first texel is no value; and back.
  function texelOf(level) { return level ? (1.5 + (level - 1) / 65534 * (TEXELS - 2)) / TEXELS : 0; }
  function shareOf(texel) { return texel * TEXELS < 1 ? null : Math.max(0, Math.min(1, (texel * TEXELS - 1.5) / (TEXELS - 2))); }

  function decoded(scene) {
    var low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
    var parts = scene.parts.map(function (part) {
      var points = numbers(part.points), xyz = new Float32Array(points.length), fields = { of_point: {}, of_triangle: {} }, k;
      for (k = 0; k < points.length; k++) {
        xyz[k] = scene.step * points[k];
        low[k % 3] = Math.min(low[k % 3], xyz[k]); high[k % 3] = Math.max(high[k % 3], xyz[k]);
      }
      Object.keys(fields).forEach(function (kind) {
        Object.keys(part[kind]).forEach(function (key) { fields[kind][key] = numbers(part[kind][key]); });
      });
      return { name: part.name, kind: part.kind, data: part, xyz: xyz, triangles: numbers(part.triangles, part.wide),
               ofPoint: fields.of_point, ofTriangle: fields.of_triangle };
    });
    // What a box cuts off: a little beyond it stays, as its sides may be sides of the mesh.
    var sides = [], edge = scene.step, whole = [low.slice(), high.slice()];
    if (scene.box) [0, 1, 2].forEach(function (k) {
      var from = scene.box[k][0] - scene.low[k], to = scene.box[k][1] - scene.low[k], normal = [0, 0, 0];
      normal[k] = 1;
      sides.push(new THREE.Plane(new THREE.Vector3().fromArray(normal), edge - from), new THREE.Plane(new THREE.Vector3().fromArray(normal).negate(), to + edge));
      low[k] = Math.max(low[k], from); high[k] = Math.min(high[k], to);
    });
    var around = [low.slice(), high.slice()], far = Math.hypot(high[0] - low[0], high[1] - low[1]);
    scene.holes.map(function (h) { return h.collar; }).concat(Object.keys(scene.receivers).map(function (n) { return scene.receivers[n].position; })).forEach(function (given) {
      var at = given.map(function (v, k) { return v - scene.low[k]; });
      if ([0, 1].every(function (k) { return at[k] > low[k] - far && at[k] < high[k] + far; }))
        [0, 1, 2].forEach(function (k) { around[0][k] = Math.min(around[0][k], at[k]); around[1][k] = Math.max(around[1][k], at[k]); });
    });
    return { parts: parts, whole: whole, around: around, low: low, high: high, sides: sides };
  }

  // Corners of the edges that one triangle alone has.
  function edgesOf(part) {
    var seen = new Map(), t = part.triangles, out = [], n;
    for (n = 0; n < t.length; n++) {
      var i = t[n], j = t[n % 3 === 2 ? n - 2 : n + 1], key = Math.min(i, j) * 4294967296 + Math.max(i, j);
      seen.set(key, seen.has(key) ? null : [i, j]);
    }
    seen.forEach(function (pair) {
      if (pair) pair.forEach(function (k) { out.push(part.xyz[3 * k], part.xyz[3 * k + 1], part.xyz[3 * k + 2]); });
    });
    return out;
  }

  function baseOf(part, triangle, key) {
    if (part.kind !== "ground") return PLANE[part.kind];
    var base = rgb(GROUND[part.ofTriangle.group[triangle] % GROUND.length]);
    if (key === "removable" && part.ofTriangle.removable[triangle]) return REMOVABLE;
    if (key !== "block") return base;
    var turn = Math.sin(12.9898 * (part.ofTriangle.block[triangle] + 1)) * 43758.5453, shade = 0.78 + 0.4 * (turn - Math.floor(turn));
    return base.map(function (v) { return Math.min(255, v * shade); });
  }

  // Mesh of a part: corners of their own for each triangle, as values of zones change from one to the next.
  function meshOf(part, how) {
    var geometry = new THREE.BufferGeometry(), t = part.triangles, place = new Float32Array(3 * t.length), n;
    for (n = 0; n < t.length; n++) place.set(part.xyz.subarray(3 * t[n], 3 * t[n] + 3), 3 * n);
    geometry.setAttribute("position", new THREE.BufferAttribute(place, 3));
    geometry.setAttribute("color", new THREE.BufferAttribute(new Uint8Array(3 * t.length), 3, true));
    geometry.setAttribute("uv", new THREE.BufferAttribute(new Float32Array(2 * t.length), 2));
    return new THREE.Mesh(geometry, new THREE.MeshLambertMaterial(Object.assign({ vertexColors: true, flatShading: true }, how)));
  }
  // Faces of the ground that are seen from inside, in the colour of their material.
  function insideOf(part, front, how) {
    var geometry = new THREE.BufferGeometry(), rock = new Uint8Array(3 * part.triangles.length), n;
    for (n = 0; n < part.triangles.length; n++) rock.set(baseOf(part, Math.floor(n / 3), "material"), 3 * n);
    geometry.setAttribute("position", front.geometry.attributes.position);
    geometry.setAttribute("color", new THREE.BufferAttribute(rock, 3, true));
    return new THREE.Mesh(geometry, new THREE.MeshBasicMaterial(Object.assign({ vertexColors: true, side: THREE.BackSide }, how)));
  }
  // Counts faces along a line of sight: 1 is left where it enters a closed body at a plane that clips it.
  function counted(planes, operation) {
    return { clippingPlanes: planes, stencilWrite: true, stencilZFail: operation, stencilZPass: operation };
  }
  // The plane itself there: a shade over what is seen behind it, and its depth.
  function capOf(plane, others, tone, size) {
    var material = new THREE.MeshBasicMaterial({ color: new THREE.Color(tone, tone, tone), side: THREE.DoubleSide, clippingPlanes: others, depthFunc: THREE.AlwaysDepth, blending: THREE.MultiplyBlending,
                                                 premultipliedAlpha: true, stencilWrite: true, stencilRef: 1, stencilFunc: THREE.EqualStencilFunc });
    var cap = new THREE.Mesh(new THREE.PlaneGeometry(9 * size, 9 * size), material);
    cap.onPlane = function () {
      cap.visible = plane.constant < FAR;
      plane.coplanarPoint(cap.position);
      cap.lookAt(cap.position.clone().add(plane.normal));
    };
    cap.renderOrder = 1;
    return cap;
  }
  function colour(mesh, part, key, values, scale) {
    var t = part.triangles, colours = mesh.geometry.attributes.color, texels = mesh.geometry.attributes.uv, n, k;
    var points = scale && part.ofPoint[values], faces = scale && part.ofTriangle[key];
    for (n = 0; n < t.length; n += 3) {
      var known = points ? points[t[n]] && points[t[n + 1]] && points[t[n + 2]] : faces && faces[n / 3], base = known ? WHITE : baseOf(part, n / 3, key);
      for (k = n; k < n + 3; k++) {
        colours.array.set(base, 3 * k);
        texels.array[2 * k] = known ? texelOf(points ? points[t[k]] : faces[n / 3]) : 0;
      }
    }
    colours.needsUpdate = texels.needsUpdate = true;
    mesh.material.needsUpdate = Boolean(mesh.material.map) !== Boolean(scale);
    mesh.material.map = scale ? scale.texture : null;
  }

  // What stands in the ground is drawn twice: faint where it is hidden, then where it is seen.
  function twice(make) {
    return [{ depthTest: false, transparent: true, opacity: FAINT }, {}].map(function (how) {
      var made = make(how);
      made.renderOrder = how.depthTest === false ? 2 : 3;
      return made;
    });
  }
  // Segments between pairs of places, in one colour or one for each place.
  function linesOf(places, wide, colours, planes, seen) {
    var paint = Array.from(places, function (_, k) { return (colours.length > 3 ? colours[k] : colours[k % 3]) / 255; });
    function make(how) {
      var geometry = new THREE.LineSegmentsGeometry().setPositions(places).setColors(paint);
      return new THREE.LineSegments2(geometry, new THREE.LineMaterial(Object.assign({ linewidth: wide, vertexColors: true, clippingPlanes: planes, polygonOffset: true, polygonOffsetUnits: -8000 }, how)));
    }
    var drawn = seen ? [make({})] : twice(make);
    if (seen) drawn[0].renderOrder = 3;
    return drawn;
  }
  function pointsOf(marks, size, symbol) {
    var canvas = document.createElement("canvas"), pen = canvas.getContext("2d");
    canvas.width = canvas.height = 64;
    pen.fillStyle = "#fff"; pen.strokeStyle = "#222"; pen.lineWidth = 4; pen.lineJoin = "round";
    symbol(pen);
    var texture = new THREE.CanvasTexture(canvas), geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.BufferAttribute(new Float32Array([].concat.apply([], marks.map(function (m) { return m.at; }))), 3));
    geometry.setAttribute("color", new THREE.BufferAttribute(new Uint8Array([].concat.apply([], marks.map(function (m) { return m.colour; }))), 3, true));
    return twice(function (how) {
      var points = new THREE.Points(geometry, new THREE.PointsMaterial(Object.assign({ size: size, sizeAttenuation: false, map: texture, vertexColors: true, alphaTest: 0.4 }, how)));
      points.marks = marks;
      return points;
    });
  }
  function disc(pen) { pen.beginPath(); pen.arc(32, 32, 28, 0, 7); pen.fill(); pen.stroke(); }
  function cone(pen) { pen.beginPath(); pen.moveTo(32, 34); pen.lineTo(16, 4); pen.lineTo(48, 4); pen.closePath(); pen.fill(); pen.stroke(); }
  function star(pen) {
    pen.strokeStyle = "#fff"; pen.lineWidth = 7;
    for (var k = 0; k < 4; k++) {
      var x = 28 * Math.cos(k * Math.PI / 4), y = 28 * Math.sin(k * Math.PI / 4);
      pen.beginPath(); pen.moveTo(32 - x, 32 - y); pen.lineTo(32 + x, 32 + y); pen.stroke();
    }
  }

  function start(box) {
    var scene = JSON.parse(box.querySelector("script").textContent), bar = document.createElement("div"), readout = document.createElement("p"), legend = document.createElement("div");
    bar.className = "switches"; readout.className = "readout"; legend.className = "legend";
    readout.setAttribute("aria-live", "polite");
    THREE.ColorManagement.enabled = false;  // colours are those of the legend
    var renderer;
    try {
      renderer = new THREE.WebGLRenderer({ antialias: true, stencil: true, preserveDrawingBuffer: true });  // kept for print
    } catch {
      readout.textContent = "This browser has no WebGL, which draws the model in three dimensions; maps, sections and tables show it, too.";
      box.prepend(readout);
      return;
    }
    var model = decoded(scene), stage = document.createElement("div"), canvas = renderer.domElement;
    var size = Math.hypot(model.high[0] - model.low[0], model.high[1] - model.low[1], model.high[2] - model.low[2]) || 1;
    var middle = new THREE.Vector3().fromArray(model.around[0]).add(new THREE.Vector3().fromArray(model.around[1])).multiplyScalar(0.5);
    box.querySelector("details").open = false;
    stage.className = "stage";
    canvas.tabIndex = 0; canvas.setAttribute("role", "application");
    canvas.setAttribute("aria-label", scene.title + ": model in three dimensions. Arrow keys turn, plus and minus zoom, n names the next thing, c cuts, brackets move the cut.");
    stage.append(canvas); box.prepend(bar, legend, stage, readout);
    function text(name) { var made = document.createElement("div"); made.className = name; stage.append(made); return made; }
    var bars = text("scale"), clock = text("clock");

    renderer.outputColorSpace = THREE.LinearSRGBColorSpace;
    renderer.localClippingEnabled = true; renderer.autoClear = false;
    renderer.setClearColor(0xffffff);
    var world = new THREE.Scene(), camera = new THREE.OrthographicCamera(), caster = new THREE.Raycaster(), sun = new THREE.DirectionalLight(0xffffff, 0.38 * Math.PI);
    camera.up.set(0, 0, 1);
    sun.position.set(-0.35, -0.5, 0.79);
    world.add(sun, new THREE.AmbientLight(0xffffff, 0.62 * Math.PI));
    var names = new THREE.CSS2DRenderer(), helper = new THREE.ViewHelper(camera, canvas);
    names.domElement.className = "names"; stage.append(names.domElement);
    helper.setLabels("E", "N", "up");
    function local(at) { return at.map(function (v, k) { return v - scene.low[k]; }); }

    // Planes that clip the ground: the cut, and the sides of the box; those that look away are set far off.
    var live = [new THREE.Plane(new THREE.Vector3(0, 1, 0), FAR)].concat(model.sides.map(function (p) { return p.clone(); })), labels = [], marks = [], symbols = [];
    model.parts.forEach(function (part) {
      var ground = part.kind === "ground", how = { side: THREE.DoubleSide, clippingPlanes: model.sides, polygonOffset: true, polygonOffsetUnits: 2000 };
      part.mesh = meshOf(part, ground ? counted(live, THREE.DecrementWrapStencilOp) : how);
      part.drawn = [part.mesh];
      if (!ground && part.triangles.length) part.drawn = part.drawn.concat(linesOf(edgesOf(part), part.kind === "joint" ? 1 : 3, PLANE[part.kind], model.sides, true));
      world.add.apply(world, part.drawn);
    });
    var front = model.parts[0].mesh, back = insideOf(model.parts[0], front, counted(live, THREE.IncrementWrapStencilOp)), caps = live.map(function (plane, n) {
      return capOf(plane, live.filter(function (other) { return other !== plane; }), n === 0 ? 1 : n < 3 ? 0.78 : 0.88, size);
    });
    var depths = [front, back].map(function (mesh) {  // alone, before a ground that one sees through
      var material = mesh.material.clone();
      material.clippingPlanes = live; material.colorWrite = material.stencilWrite = false;
      return new THREE.Mesh(mesh.geometry, material);
    });
    world.add.apply(world, [back].concat(caps, depths));

    function label(at, words, first, part) {
      var element = document.createElement("div");
      element.textContent = words;
      var made = new THREE.CSS2DObject(element);
      made.position.fromArray(at); made.center.set(0, 1); made.part = part;
      if (first) labels.unshift(made);
      else labels.push(made);
      world.add(made);
      return element;
    }
    function stand(rows, size, symbol) {
      marks = marks.concat(rows);
      if (!rows.length) return null;
      var made = pointsOf(rows, size, symbol);
      symbols.push(made[1]);
      world.add.apply(world, made);
      return made[1];
    }
    var posts = Object.keys(scene.receivers).map(function (name) {
      var r = scene.receivers[name];
      return { at: local(r.position), name: name, values: r.values, azimuth: r.azimuth, colour: rgb(r.over ? OVER : RECEIVER), words: "receiver " + name, rows: r.rows };
    }), stood = null;
    function receivers() {
      var arrows = [];
      stood = stand(posts, 30, cone);
      posts.forEach(function (r) {
        r.label = label(r.at, r.name, true);
        if (r.azimuth !== null && r.azimuth !== undefined) arrows.push(r.at[0], r.at[1], r.at[2], r.at[0] + 0.06 * size * Math.sin(r.azimuth), r.at[1] + 0.06 * size * Math.cos(r.azimuth), r.at[2]);
      });
      if (arrows.length) world.add.apply(world, linesOf(arrows, 2, rgb(RECEIVER), []));
    }
    function paintReceivers(key) {
      posts.forEach(function (r, n) {
        var value = r.values[key], known = value !== undefined;
        stood.geometry.attributes.color.array.set(known ? scales[key].of(value) : r.colour, 3 * n);
        r.label.textContent = r.name + (known ? " " + short(value) + " " + scene.fields[key].unit : "");
      });
      if (stood) stood.geometry.attributes.color.needsUpdate = true;
    }
    // Where residuals come from: a ring on the ground as wide as it is known.
    function located(point) {
      var at = local([point.x, point.y, 0]), ring = [], k;
      caster.set(new THREE.Vector3(at[0], at[1], model.whole[1][2] + size), new THREE.Vector3(0, 0, -1));
      var below = caster.intersectObject(front, false)[0], height = below ? below.point.z : model.high[2];
      for (k = 0; k < 72; k++) [k, k + 1].forEach(function (n) {
        ring.push(at[0] + point.within_m * Math.cos(n * Math.PI / 36), at[1] + point.within_m * Math.sin(n * Math.PI / 36), height);
      });
      world.add.apply(world, linesOf(ring, 3, PLANE.named, []));
      label([at[0], at[1] + point.within_m, height], "the residual comes from here", false);
    }
    function holes() {
      var bores = [], charges = [], paint = [];
      var rows = scene.holes.map(function (hole) {
        var colour = css2rgb("hsl(" + (250 - 200 * hole.late) + ",75%,38%)"), at = local(hole.collar);
        bores = bores.concat(at, local(hole.toe)); charges = charges.concat(local(hole.column[0]), local(hole.column[1]));
        paint = paint.concat(colour, colour);
        return { at: at, colour: colour, words: "hole " + hole.name + ", number " + hole.order + " to fire", rows: hole.rows };
      });
      if (rows.length) world.add.apply(world, linesOf(bores, 1.5, paint, []).concat(linesOf(charges, 4, paint, [])));
      stand(rows, 8, disc);
      rows.forEach(function (row, n) { label(row.at, String(scene.holes[n].order), false); });
    }
    function css2rgb(text) { var c = new THREE.Color(text); return [c.r, c.g, c.b].map(function (v) { return Math.round(255 * v); }); }
    holes();
    stand(scene.sources.map(function (at, n) { return { at: local(at), colour: rgb(OVER), words: "source " + (n + 1), rows: [] }; }), 16, star);
    receivers();
    scene.located.forEach(located);
    model.parts.forEach(function (part) {
      var best = 0, k, xyz = part.xyz;
      if (part.kind === "ground" || part.kind === "joint" && part.data.area < 0.02 * size * size) return;
      for (k = 0; k < xyz.length; k += 3) if (xyz[k + 2] > xyz[best + 2] || xyz[k + 2] > xyz[best + 2] - 1e-3 * size && xyz[k + 1] > xyz[best + 1]) best = k;
      label([xyz[best], xyz[best + 1], xyz[best + 2]], part.name, true, part);
    });

    var scales = {}, frame = null, playing = null, cutting = null, knife = null, share = 0.5, solid = 1, marked = -1;
    Object.keys(scene.fields).forEach(function (key) { scales[key] = colours(scene.fields[key], key); });
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
    function slider(words, name, value, change) {
      var label = document.createElement("label"), input = document.createElement("input");
      input.type = "range"; input.min = 0; input.max = 100; input.value = value;
      input.oninput = function () { change(Number(input.value) / 100); draw(); };
      input.setAttribute("aria-label", name);
      label.append(words + " ", input); bar.append(label);
      return input;
    }
    var fields = [["material", "material"]], first = model.parts[0].ofTriangle;
    if (first.block && first.block.some(function (b) { return b > 0; })) fields.push(["block", "blocks"]);
    if (first.removable && first.removable.some(Boolean)) fields.push(["removable", "removable blocks"]);
    Object.keys(scene.fields).forEach(function (key) { fields.push([key, scene.fields[key].label + (scene.fields[key].unit ? " [" + scene.fields[key].unit + "]" : "")]); });
    var field = choice("colour", fields, function () { stop(); paint(); });
    field.className = "field";
    field.value = ["misfit", "ppv", "material"].filter(function (key) { return key === "material" || scene.fields[key]; })[0];
    var looks = [["", "look …"], ["above", "from above"], ["south", "from the south"], ["east", "from the east"], ["corner", "from a corner"]];
    if (scene.wall !== null) looks.push(["wall", "at the wall"], ["along", "along the wall"]);
    model.parts.forEach(function (part, n) { if (part.kind !== "ground") looks.push(["plane" + n, "along " + part.name]); });
    var look = choice("", looks, function (value) { turnTo(value); look.value = ""; });
    look.setAttribute("aria-label", "look from");
    var cut = choice("cut", [["", "not"], ["east", "across east"], ["north", "across north"], ["seen", "facing me"]], function (value) {
      var to = camera.getWorldDirection(new THREE.Vector3()), flat = Math.hypot(to.x, to.y) || 1;
      cutting = value ? { east: [1, 0], north: [0, -1], seen: [-to.x / flat, -to.y / flat] }[value] : null;
      cutNow();
    });
    cut.className = "cut";
    var cutAt = slider("at", "place of the cut", 50, function (v) { share = v; cutNow(); });
    slider("ground", "how solid the ground is", 100, function (v) { solid = v; });
    var many = 0, planes = null;
    model.parts.forEach(function (part) { if (part.kind === "joint") many += part.triangles.length / 3; });
    function hide(value) {
      model.parts.forEach(function (part) {
        part.hidden = part.kind !== "ground" && (value === "none" || value === "faults" && part.kind === "joint");
        part.drawn.forEach(function (one) { one.visible = !part.hidden; });
      });
    }
    if (many) {
      planes = choice("planes", [["all", "all"], ["faults", "faults alone"], ["none", "none"]], hide);
      planes.className = "planes";
      planes.value = many > 2000 ? "faults" : "all";  // sets before a cut would hide it
      hide(planes.value);
    }
    if (scene.times.length) {
      var play = document.createElement("button");
      play.textContent = "play the motion";
      play.onclick = function () { if (playing) { clearTimeout(playing); playing = null; return; } field.value = "speed"; stop(); step(); };
      bar.append(play);
    }
    function step() {
      paint(); draw();
      playing = setTimeout(function () { frame = (frame + 1) % scene.times.length; step(); }, 180);
    }
    function stop() { clearTimeout(playing); playing = null; frame = field.value === "speed" ? 0 : null; }
    function paint() {
      var key = field.value;
      model.parts.forEach(function (part) { colour(part.mesh, part, key, key === "speed" ? "speed" + frame : key, scales[key]); });
      paintReceivers(key);
      clock.textContent = frame === null ? "" : scene.times[frame].toFixed(3) + " s";
      keys();
    }

    // Look to a bearing (from north to east) and down by an angle, in rad.
    function lookTo(bearing, down) {
      var far = 2 * size, flat = far * Math.cos(down);
      camera.position.set(controls.target.x - flat * Math.sin(bearing), controls.target.y - flat * Math.cos(bearing), controls.target.z + far * Math.sin(down));
      controls.update();
    }
    function turnTo(value) {
      var rad = Math.PI / 180, plane = value.slice(0, 5) === "plane" ? model.parts[Number(value.slice(5))].data : null, wall = scene.wall * rad;
      var to = plane ? [(plane.direction + 90) * rad, 0.05] : { above: [0, Math.PI / 2 - 1e-4], south: [0, 0], east: [-Math.PI / 2, 0], corner: [-0.6, 0.5], wall: [wall + Math.PI, 0.25], along: [wall + Math.PI / 2, 0.1] }[value];
      controls.target.copy(middle); camera.zoom = 1; camera.updateProjectionMatrix();
      if (to) lookTo(to[0], to[1]);
    }
    function turnBy(side, down) {
      var to = camera.getWorldDirection(new THREE.Vector3());
      lookTo(Math.atan2(to.x, to.y) + side, Math.max(-0.6, Math.min(Math.PI / 2 - 1e-4, Math.asin(-to.z) + down)));
    }
    function cutNow() {
      var n = cutting, all = n && [[0, 0], [0, 1], [1, 0], [1, 1]].map(function (k) {
        return n[0] * (k[0] ? model.high[0] : model.low[0]) + n[1] * (k[1] ? model.high[1] : model.low[1]); });
      if (!n) { knife = null; return; }
      var low = Math.min.apply(null, all), high = Math.max.apply(null, all);
      knife = new THREE.Plane(new THREE.Vector3(-n[0], -n[1], 0), low + share * (high - low));
    }
    // The half before the cut goes, whichever it is; sides of the box that look away clip nothing.
    function clip() {
      var to = camera.getWorldDirection(new THREE.Vector3());
      [knife].concat(model.sides).forEach(function (plane, n) {
        if (plane) live[n].copy(plane);
        if (!n && plane && plane.normal.dot(to) < 0) live[n].negate();
        if (!plane || live[n].normal.dot(to) < 1e-6) live[n].constant = FAR;
        caps[n].onPlane();
      });
    }

    // Pixels of a metre.
    function fit() {
      var width = stage.clientWidth || 600, height = Math.round(width < 500 ? 0.95 * width : Math.max(280, Math.min(0.62 * width, 620)));
      var b = model.around, wide = Math.hypot(b[1][0] - b[0][0], b[1][1] - b[0][1]), tall = 0.5 * wide + 0.9 * (b[1][2] - b[0][2]), scale = 0.94 * Math.min(width / wide, height / tall);
      renderer.setPixelRatio(Math.min(2, window.devicePixelRatio || 1));
      renderer.setSize(width, height); names.setSize(width, height);
      camera.left = -0.5 * width / scale; camera.right = -camera.left; camera.top = 0.5 * height / scale; camera.bottom = -camera.top;
      camera.near = -2 * size; camera.far = 6 * size;
      camera.updateProjectionMatrix();
    }
    function pixels() { return camera.zoom * canvas.clientWidth / (camera.right - camera.left); }
    function tidy() {  // labels that would lie on others are left out, and those of what is hidden
      var kept = [], at = new THREE.Vector3(), w = canvas.clientWidth / 2, h = canvas.clientHeight / 2;
      labels.forEach(function (one) {
        at.copy(one.position).project(camera);
        var x = w * at.x, y = h * at.y;
        var wide = Math.max(APART, 6 * one.element.textContent.length);  // px, about
        one.visible = !(one.part && one.part.hidden) && !kept.some(function (k) { return x < k[0] + k[2] && k[0] < x + wide && Math.abs(k[1] - y) < APART; });
        if (one.visible) kept.push([x, y, wide]);
      });
      var metres = Math.pow(10, Math.floor(Math.log10(0.6 * w / pixels())));
      [5, 2].some(function (m) { if (m * metres * pixels() < 0.6 * w) { metres *= m; return true; } return false; });
      bars.textContent = short(metres) + " m"; bars.style.width = Math.round(metres * pixels()) + "px";
    }
    function draw() {
      var begun = performance.now();
      var through = solid < 1;
      [front, back].forEach(function (mesh) {
        mesh.visible = solid > 0; mesh.material.opacity = solid;
        mesh.material.needsUpdate = mesh.material.transparent !== through; mesh.material.transparent = through;
      });
      depths.forEach(function (mesh) { mesh.visible = through && solid > 0; });
      model.parts.slice(1).forEach(function (part) { part.mesh.renderOrder = through ? -1 : 2; });
      clip();
      if (through) caps.forEach(function (cap) { cap.visible = false; });
      camera.updateMatrixWorld(); tidy();
      renderer.clear(); renderer.render(world, camera); names.render(world, camera); helper.render(renderer);
      canvas.dataset.ms = Math.round(performance.now() - begun);
    }

    function keys() {
      legend.textContent = "";
      function one(colour, text) {
        var span = document.createElement("span"), sign = document.createElement("b");
        sign.className = "swatch"; sign.style.background = colour; span.append(sign, text); legend.append(span);
      }
      var key = field.value, shown = scene.fields[key];
      if (shown) {
        var edges = [shown.low].concat(scales[key].edges), each = Math.ceil(edges.length / 9);
        edges.forEach(function (edge, n) { if (n % each === 0) one(css(scales[key].of(edge)), "from " + short(edge)); });
        legend.append(shown.unit + (shown.unit ? ", " : "") + "up to " + short(shown.high));
      } else scene.groups.forEach(function (name, n) { one(GROUND[n % GROUND.length], name); });
      if (key === "removable") one(css(REMOVABLE), "could move out past its joints");
      Object.keys(PLANE).forEach(function (kind) {
        if (model.parts.some(function (part) { return part.kind === kind; })) one(css(PLANE[kind]), KIND[kind]);
      });
    }

    // What is seen at a place of the stage: a mark, or the first face that no plane clips.
    function tell(x, y) {
      caster.setFromCamera(new THREE.Vector2(2 * x / canvas.clientWidth - 1, 1 - 2 * y / canvas.clientHeight), camera);
      caster.params.Points.threshold = PICK / pixels();
      var near = caster.intersectObjects(symbols, false).sort(function (a, b) { return a.distanceToRay - b.distanceToRay; })[0];
      if (near) { name(near.object.marks[near.index]); return; }
      var best = null;
      model.parts.forEach(function (part) {
        if (part.hidden || part.kind === "ground" && solid < 0.5) return;
        var hit = caster.intersectObjects(part.kind === "ground" ? [front, back] : [part.mesh], false).filter(function (h) {
          return (part.kind === "ground" ? live : model.sides).every(function (p) { return p.distanceToPoint(h.point) > -1e-6 * size; });
        })[0];
        if (hit && part.kind === "ground") onCut(hit);
        if (hit && (!best || hit.distance < best[1].distance)) best = [part, hit];
      });
      if (!best) { readout.textContent = "Nothing is there."; return; }
      var part = best[0], hit = best[1], at = hit.point.toArray(), words = [(part.kind === "ground" ? "" : KIND[part.kind] + " ") + part.name + " at " + places(at)];
      var shown = scene.fields[field.value], texel = shown && !hit.inside ? shareOf(hit.uv.x) : null, side = part.kind === "ground" && sideAt(at);
      if (part.kind === "ground") words.push(scene.groups[part.ofTriangle.group[hit.faceIndex]]);
      if (texel !== null) words.push(shown.label + " " + short(valueOf(shown, texel)) + " " + shown.unit);
      if (side) words.push(side);
      if (part.data.dip !== undefined) words.push("dip " + Math.round(part.data.dip) + "°, dip direction " + Math.round(part.data.direction) + "°");
      if (part.data.largest_slip !== undefined) words.push("largest slip " + short(part.data.largest_slip) + " mm");
      readout.textContent = words.join("; ");
    }
    // Move a face that is seen from inside to the cut before it.
    function onCut(hit) {
      var to = caster.ray.direction, way = Infinity;
      if (hit.object !== back) return;
      live.forEach(function (p) {
        var rise = p.normal.dot(to);
        if (rise > 1e-6) way = Math.min(way, p.distanceToPoint(hit.point) / rise);
      });
      if (way > 0.5 * FAR) return;
      hit.inside = true; hit.distance -= way; hit.point.addScaledVector(to, -way);
    }
    function sideAt(at) {
      var near = 2e-3 * size, found = [["west", 0, 0], ["east", 1, 0], ["south", 0, 1], ["north", 1, 1], ["bottom", 0, 2]].filter(function (s) {
        return Math.abs(at[s[2]] - (s[1] ? model.high : model.low)[s[2]]) < near;
      });
      if (found.length !== 1) return null;
      var k = found[0][2], gap = Math.abs(model.whole[found[0][1]][k] - (found[0][1] ? model.high : model.low)[k]);
      return found[0][0] + " side: " + (gap > near ? "the mesh goes on beyond it" : scene.sides[found[0][0]] || "free");
    }
    function places(at) {
      var site = at.map(function (v, k) { return (v + scene.low[k]).toFixed(1); });
      return "east " + site[0] + ", north " + site[1] + ", height " + site[2] + " m";
    }
    function name(mark) {
      readout.textContent = mark.words + " at " + places(mark.at) + mark.rows.map(function (row) { return "; " + row[0] + " " + row[1]; }).join("");
    }

    var pressed = null;
    canvas.addEventListener("pointerdown", function (event) {
      pressed = [event.clientX, event.clientY]; controls.enableZoom = true; canvas.focus({ preventScroll: true });
    });
    canvas.addEventListener("pointerup", function (event) {
      var place = canvas.getBoundingClientRect();
      if (pressed && Math.hypot(event.clientX - pressed[0], event.clientY - pressed[1]) < 5) tell(event.clientX - place.left, event.clientY - place.top);
      pressed = null;
    });
    canvas.addEventListener("blur", function () { controls.enableZoom = false; });  // a page that is scrolled goes on
    canvas.onkeydown = function (event) {
      var side = { ArrowLeft: [1, 0], ArrowRight: [-1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[event.key];
      if (side && event.shiftKey) controls.pan(30 * side[0], 30 * side[1]);
      else if (side) turnBy(-0.1 * side[0], 0.1 * side[1]);
      else if ("+=-".indexOf(event.key) >= 0) { camera.zoom *= event.key === "-" ? 1 / 1.2 : 1.2; camera.updateProjectionMatrix(); }
      else if (event.key === "c") { cut.selectedIndex = (cut.selectedIndex + 1) % cut.options.length; cut.onchange(); }
      else if (event.key === "[" || event.key === "]") { cutAt.value = Number(cutAt.value) + (event.key === "]" ? 5 : -5); cutAt.oninput(); }
      else if (event.key === "n" && marks.length) { marked = (marked + 1) % marks.length; name(marks[marked]); }
      else return;
      event.preventDefault(); draw();
    };
    var controls = new THREE.OrbitControls(camera, canvas);
    controls.enableZoom = false; controls.maxPolarAngle = Math.PI / 2 + 0.6;
    paint(); fit(); turnTo("corner");
    controls.addEventListener("change", draw);
    canvas.addEventListener("webglcontextrestored", draw);
    window.addEventListener("resize", function () { fit(); draw(); });
    readout.textContent = "Drag to turn, shift and drag to move, click for a name and numbers; wheel (after a click) or two fingers zoom.";
    draw();
  }

  document.querySelectorAll(".view").forEach(start);
})();
