// Plays DATA (see page.py): bodies, links, joints and trails over time. window.acausal lets a script drive it.
(function () {
  const byId = (id) => document.getElementById(id), paper = document.documentElement;
  const unpack = (text) => new Float32Array(Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer);
  const times = unpack(DATA.times), frames = times.length, first = times[0], last = times[frames - 1];
  const point = (p) => new THREE.Vector3(p[0], p[1], p[2]);
  const low = point(DATA.low), high = point(DATA.high), up = point(DATA.up), size = DATA.size, thin = DATA.thickness;
  const centre = low.clone().add(high).multiplyScalar(0.5);
  const toRight = point(DATA.view.right), toTop = point(DATA.view.up), toViewer = point(DATA.view.towards);
  const { solid, material, linkMakers, jointMesh } = makeSolids(thin);

  let renderer;
  try {
    renderer = new THREE.WebGLRenderer({ antialias: true, preserveDrawingBuffer: true });
  } catch (problem) {
    byId("bar").style.display = byId("legend").style.display = "none";
    showError("This browser cannot draw in 3-D: WebGL is missing or switched off.\nTry another browser, or switch hardware acceleration on in its settings.");
    return;
  }
  renderer.domElement.addEventListener("webglcontextlost", () => showError("The graphics driver gave up. Reload the page."));
  renderer.setPixelRatio(Math.min(window.devicePixelRatio, 2));
  renderer.shadowMap.enabled = true;
  renderer.shadowMap.type = THREE.PCFShadowMap;
  document.body.prepend(renderer.domElement);

  // light, ground and theme
  const scene = new THREE.Scene(), sky = new THREE.HemisphereLight(0xffffff, 0xb8c4d0, 1.9), sun = new THREE.DirectionalLight(0xffffff, 2.1);
  const offset = up.clone().multiplyScalar(2.0).addScaledVector(toRight, -0.7).addScaledVector(toViewer, Math.abs(toViewer.dot(up)) > 0.9 ? 0 : 0.8);
  if (DATA.view.planar && Math.abs(toViewer.dot(up)) > 0.9) offset.addScaledVector(toTop, 0.6);
  sun.position.copy(centre).addScaledVector(offset, size);
  sun.target.position.copy(centre);
  sun.castShadow = true;
  sun.shadow.mapSize.set(2048, 2048);
  Object.assign(sun.shadow.camera, { left: -0.8 * size, right: 0.8 * size, top: 0.8 * size, bottom: -0.8 * size, near: 0.05 * size, far: 6 * size });
  sun.shadow.radius = 3;
  sun.shadow.normalBias = 0.0025 * size;
  const fill = new THREE.DirectionalLight(0xffffff, 0.9); // from the viewer, without shadows
  fill.position.copy(centre).addScaledVector(toViewer, size).addScaledVector(toRight, 0.4 * size);
  fill.target = sun.target;
  scene.add(sky, sun, fill, sun.target);
  scene.fog = new THREE.Fog(0xffffff, 1, 2);
  const ground = centre.clone().addScaledVector(up, DATA.floor - centre.dot(up) - 0.003 * size);
  const decade = Math.pow(10, Math.floor(Math.log10(size / 4))), cell = decade * (size / 4 / decade >= 5 ? 5 : size / 4 / decade >= 2 ? 2 : 1);
  const shade = new THREE.Mesh(new THREE.PlaneGeometry(20 * size, 20 * size), new THREE.ShadowMaterial());
  shade.quaternion.setFromUnitVectors(new THREE.Vector3(0, 0, 1), up);
  shade.position.copy(ground).addScaledVector(up, -1e-3 * size);
  shade.receiveShadow = true;
  scene.add(shade);
  const [unit, factor] = cell >= 1e3 ? ["km", 1e-3] : cell >= 1 ? ["m", 1] : cell >= 1e-3 ? ["mm", 1e3] : ["µm", 1e6];
  byId("scale").textContent = "one square: " + Number((factor * cell).toPrecision(3)) + " " + unit;
  const metal = material("#5b6774"), linkLooks = { spring: material("#3d4957"), damper: material("#8a63c4"), force: material("#d1495b"), string: material("#8d7b68"), cone: material("#e09f3e") };
  function squares(colour) { // many short lines on a disc: a long one that passes behind the camera is clipped badly by some drivers
    const count = 60, points = [];
    for (let i = -count; i <= count; i++) for (let j = -count; j < count; j++) {
      if (Math.hypot(i, j) < count) points.push(i * cell, 0, j * cell, i * cell, 0, (j + 1) * cell, j * cell, 0, i * cell, (j + 1) * cell, 0, i * cell);
    }
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.Float32BufferAttribute(points, 3));
    return new THREE.LineSegments(geometry, new THREE.LineBasicMaterial({ color: colour }));
  }
  let stale = true; // something changed since the last drawing
  let grid = null, dark = window.matchMedia("(prefers-color-scheme: dark)").matches;
  function applyTheme() {
    document.documentElement.dataset.theme = dark ? "dark" : "light";
    byId("theme").textContent = dark ? "Light" : "Dark";
    scene.background = new THREE.Color(dark ? "#12171e" : "#eef2f6");
    scene.fog.color.copy(scene.background);
    sky.groundColor.set(dark ? "#303b48" : "#b8c4d0");
    sky.intensity = dark ? 1.3 : 1.7;
    shade.material.opacity = dark ? 0.5 : 0.18;
    metal.color.set(dark ? "#b4c0cd" : "#5b6774");
    linkLooks.spring.color.set(dark ? "#c9d3de" : "#3d4957");
    if (grid) { scene.remove(grid); grid.geometry.dispose(); grid.material.dispose(); }
    grid = squares(dark ? "#3a4756" : "#bcc7d3");
    grid.quaternion.setFromUnitVectors(new THREE.Vector3(0, 1, 0), up);
    grid.position.copy(ground);
    scene.add(grid);
    stale = true;
  }

  // what moves
  const named = [];
  function naming(object, name) {
    object.traverse((item) => { if (item.isMesh) { item.userData.name = name; named.push(item); } });
    scene.add(object);
  }
  const bodies = DATA.bodies.map((body) => {
    const group = new THREE.Group(), colour = body.colour;
    for (const shape of body.shapes) group.add(solid(shape, colour));
    naming(group, body.name);
    return { object: group, name: body.name, colour, p: unpack(body.p), q: unpack(body.q) };
  });
  const joints = DATA.joints.map((joint) => {
    const group = new THREE.Group(), mark = jointMesh(joint.kind, metal);
    mark.quaternion.setFromUnitVectors(new THREE.Vector3(0, 1, 0), point(joint.axis).normalize());
    mark.castShadow = true;
    group.add(mark);
    naming(group, joint.name);
    return { object: group, p: unpack(joint.p), q: unpack(joint.q) };
  });
  const links = DATA.links.map((link) => {
    const a = unpack(link.a), b = unpack(link.b);
    let longest = 0, shortest = Infinity;
    for (let i = 0; i < a.length; i += 3) {
      const length = Math.hypot(b[i] - a[i], b[i + 1] - a[i + 1], b[i + 2] - a[i + 2]);
      longest = Math.max(longest, length);
      shortest = Math.min(shortest, length);
    }
    const made = linkMakers[link.kind](linkLooks[link.kind], Math.min(2.4 * thin, 0.15 * longest), shortest, longest || 1, link.slope);
    made.object.traverse((item) => { item.castShadow = link.kind !== "cone"; });
    naming(made.object, link.name);
    return { ...made, a, b };
  });
  const trails = DATA.trails.map((trail) => {
    const points = unpack(trail.p), geometry = new THREE.LineGeometry();
    geometry.setPositions(frames > 1 ? points : [...points, ...points]);
    const owner = bodies.find((body) => body.name === trail.name) || bodies.find((body) => trail.name.startsWith(body.name + "."));
    const line = new THREE.Line2(geometry, new THREE.LineMaterial({ color: owner ? owner.colour : "#7d8a99", linewidth: 2, transparent: true, opacity: 0.8, fog: true }));
    line.frustumCulled = false;
    scene.add(line);
    return line;
  });

  // legend
  function row(colour, text, thinLine) {
    const made = document.createElement("div"), swatch = document.createElement("i"), label = document.createElement("span");
    swatch.style.background = colour;
    if (thinLine) swatch.className = "line";
    label.textContent = text;
    made.append(swatch, label);
    return made;
  }
  function glow(object, on) {
    object.traverse((item) => { if (item.isMesh && item.material.emissive) item.material.emissive.set(on ? "#3a3a3a" : "#000000"); });
    stale = true;
  }
  function fillLegend() {
    const rows = bodies.slice(0, 24).map((body) => {
      const made = row(body.colour, body.name, false);
      made.onmouseenter = () => glow(body.object, true);
      made.onmouseleave = () => glow(body.object, false);
      return made;
    });
    if (bodies.length > 24) rows.push(row("transparent", "and " + (bodies.length - 24) + " more", false));
    for (const kind of Object.keys(linkLooks)) if (DATA.links.some((link) => link.kind === kind)) rows.push(row("#" + linkLooks[kind].color.getHexString(), kind === "cone" ? "friction cone" : kind, true));
    if (joints.length) rows.push(row("#" + metal.color.getHexString(), "joint", false));
    byId("legend").replaceChildren(...rows);
    if (!rows.length) byId("legend").style.display = "none";
  }

  // camera
  const camera = new THREE.PerspectiveCamera(30, 1, 0.002 * size, 100 * size);
  camera.up.copy(up);
  const controls = new THREE.OrbitControls(camera, renderer.domElement);
  Object.assign(controls, { enableDamping: true, dampingFactor: 0.12, minDistance: 0.02 * size, maxDistance: 25 * size });
  let untouched = true; // the first view is fitted again when the window changes, until somebody moves the camera
  controls.addEventListener("start", () => { untouched = false; });
  function free() { // part of the window [px] that no panel covers
    const head = byId("head").getBoundingClientRect(), legend = byId("legend").getBoundingClientRect(), bar = byId("bar").getBoundingClientRect();
    const beside = legend.width ? Math.min(legend.width + 28, 0.35 * paper.clientWidth) : 14, above = head.bottom + 10, below = paper.clientHeight - bar.top + 10;
    const width = Math.max(paper.clientWidth - 14 - beside, 40), height = Math.max(paper.clientHeight - above - below, 40);
    return { x: 14 + width / 2, y: above + height / 2, width, height };
  }
  function home() { // the nearest place on the view's axis from which the box around the motion is inside the free part of the window
    const room = free(), slope = (0.94 * Math.tan((camera.fov * Math.PI) / 360)) / paper.clientHeight, axes = [toRight, toTop, toViewer];
    const half = axes.map((_, k) => (DATA.view.high[k] - DATA.view.low[k]) / 2), middle = new THREE.Vector3();
    axes.forEach((axis, k) => middle.addScaledVector(axis, (DATA.view.high[k] + DATA.view.low[k]) / 2));
    const distance = half[2] + Math.max(half[0] / (slope * room.width), half[1] / (slope * room.height));
    controls.target.copy(middle);
    // a hair below the pole, so that a view from above knows which side is up
    camera.position.copy(middle).addScaledVector(toViewer, Math.max(distance, 0.5 * size)).addScaledVector(toTop, Math.abs(toViewer.dot(up)) > 0.99 ? -1e-4 * size : 0);
    controls.update();
    untouched = true;
    follow(null);
  }
  let followed = null; // the body that the camera keeps in the middle
  const lag = new THREE.Vector3();
  function follow(body) {
    followed = body;
    byId("follow").value = body ? String(bodies.indexOf(body)) : "";
    if (body) untouched = false;
    keepUp();
  }
  function keepUp() {
    if (!followed) return;
    lag.copy(followed.object.position).sub(controls.target);
    controls.target.add(lag);
    camera.position.add(lag);
  }
  function resize() {
    const { clientWidth: width, clientHeight: height } = paper, room = free();
    renderer.setPixelRatio(Math.min(window.devicePixelRatio, 2));
    renderer.setSize(width, height, false);
    camera.aspect = width / Math.max(height, 1);
    camera.setViewOffset(width, height, width / 2 - room.x, height / 2 - room.y, width, height);
    if (untouched) home();
    stale = true;
  }
  window.addEventListener("resize", resize);

  // time
  let now = first, playing = frames > 1, rate = DATA.speed, previous = null;
  const ends = new THREE.Vector3(), qb = new THREE.Quaternion(), yAxis = new THREE.Vector3(0, 1, 0), start = new THREE.Vector3();
  const between = (out, array, i, j, s) => out.set(array[3 * i], array[3 * i + 1], array[3 * i + 2]).lerp(ends.set(array[3 * j], array[3 * j + 1], array[3 * j + 2]), s);
  const along = new THREE.Vector3();
  function place(item, i, j, s) {
    between(item.object.position, item.p, i, j, s);
    item.object.quaternion.set(item.q[4 * i + 1], item.q[4 * i + 2], item.q[4 * i + 3], item.q[4 * i]);
    item.object.quaternion.slerp(qb.set(item.q[4 * j + 1], item.q[4 * j + 2], item.q[4 * j + 3], item.q[4 * j]), s).normalize();
  }
  const digits = Math.max(2, Math.min(6, 2 - Math.floor(Math.log10(Math.max(last - first, 1e-9)))));
  function seek(t) {
    now = Math.min(last, Math.max(first, t));
    let i = 0, j = frames - 1;
    while (j - i > 1) { const k = (i + j) >> 1; if (times[k] <= now) i = k; else j = k; }
    const s = times[j] > times[i] ? (now - times[i]) / (times[j] - times[i]) : 0;
    for (const body of bodies) place(body, i, j, s);
    for (const joint of joints) place(joint, i, j, s);
    for (const link of links) {
      between(start, link.a, i, j, s);
      between(along, link.b, i, j, s).sub(start);
      const length = along.length();
      link.object.visible = length > 1e-6 * size;
      if (!link.object.visible) continue;
      link.object.position.copy(start);
      link.object.quaternion.setFromUnitVectors(yAxis, along.divideScalar(length));
      link.stretch(length);
    }
    for (const line of trails) line.geometry.instanceCount = s < 1 ? i : j;
    keepUp();
    stale = true;
    byId("scrub").value = String((now - first) / Math.max(last - first, 1e-12));
    byId("clock").textContent = now.toFixed(digits) + " s of " + last.toFixed(digits) + " s";
  }
  function setPlaying(value) { playing = value; byId("play").textContent = playing ? "Pause" : "Play"; }
  function draw() {
    const distance = camera.position.distanceTo(controls.target);
    scene.fog.near = distance + 1.2 * size;
    scene.fog.far = distance + 7 * size;
    renderer.render(scene, camera);
    stale = false;
  }

  // controls
  const exponent = Math.floor(Math.log10(DATA.speed) + 1e-9), choices = [];
  for (let e = exponent - 2; e <= exponent + 1; e++) for (const m of [1, 2, 5]) choices.push(m * Math.pow(10, e));
  if (!choices.some((choice) => Math.abs(choice / DATA.speed - 1) < 1e-3)) choices.push(DATA.speed);
  byId("speed").replaceChildren(...choices.sort((a, b) => a - b).map((shown) => {
    const option = document.createElement("option");
    option.value = String(shown);
    option.textContent = (shown >= 1e-3 ? String(Number(shown.toPrecision(2))) : shown.toExponential(1)) + " ×";
    option.selected = Math.abs(shown / DATA.speed - 1) < 1e-3;
    return option;
  }));
  function toggleTrails() {
    const shown = byId("trails").getAttribute("aria-pressed") !== "true";
    byId("trails").setAttribute("aria-pressed", String(shown));
    for (const line of trails) line.visible = shown;
    stale = true;
  }
  byId("speed").onchange = (event) => { rate = Number(event.target.value); event.target.blur(); };
  byId("play").onclick = () => { if (now >= last) seek(first); setPlaying(!playing); };
  byId("scrub").oninput = (event) => { setPlaying(false); seek(first + Number(event.target.value) * (last - first)); };
  byId("reset").onclick = home;
  bodies.forEach((body, i) => { const option = document.createElement("option"); option.value = String(i); option.textContent = "Follow " + body.name; byId("follow").append(option); });
  byId("follow").onchange = (event) => { follow(event.target.value === "" ? null : bodies[Number(event.target.value)]); stale = true; event.target.blur(); };
  if (!bodies.length) byId("follow").style.display = "none";
  byId("trails").onclick = toggleTrails;
  byId("theme").onclick = () => { dark = !dark; applyTheme(); fillLegend(); };
  if (!trails.length) byId("trails").style.display = "none";
  const step = (count) => { setPlaying(false); seek(now + (count * (last - first)) / Math.max(1, Math.min(frames - 1, 600))); };
  const keys = { Space: () => byId("play").click(), KeyT: toggleTrails, KeyR: home, ArrowLeft: () => step(-1), ArrowRight: () => step(1), Home: () => seek(first), End: () => seek(last) };
  window.addEventListener("keydown", (event) => {
    if (!keys[event.code] || event.ctrlKey || event.metaKey || event.altKey || event.target.tagName === "SELECT") return;
    event.preventDefault();
    keys[event.code]();
  });
  window.addEventListener("keyup", (event) => { if (event.code === "Space") event.preventDefault(); });
  const ray = new THREE.Raycaster(), pointer = new THREE.Vector2();
  renderer.domElement.addEventListener("pointerleave", () => { byId("tip").style.display = "none"; });
  function nameAt(event) {
    pointer.set((2 * event.clientX) / paper.clientWidth - 1, 1 - (2 * event.clientY) / paper.clientHeight);
    ray.setFromCamera(pointer, camera);
    const hit = ray.intersectObjects(named, false)[0];
    return hit ? hit.object.userData.name : null;
  }
  renderer.domElement.addEventListener("pointermove", (event) => {
    const name = event.buttons ? null : nameAt(event), tip = byId("tip");
    tip.style.display = name === null ? "none" : "block";
    if (name === null) return;
    tip.textContent = name;
    tip.style.left = Math.max(0, Math.min(event.clientX + 14, paper.clientWidth - tip.offsetWidth - 8)) + "px";
    tip.style.top = Math.min(event.clientY + 10, paper.clientHeight - tip.offsetHeight - 8) + "px";
  });
  renderer.domElement.addEventListener("dblclick", (event) => {
    const name = nameAt(event);
    follow(bodies.find((body) => body.name === name) || null);
    stale = true;
  });

  function poseOf(name) { // world pose as drawn: position [m] and quaternion, scalar first
    const body = bodies.find((item) => item.name === name);
    if (!body) return null;
    const { position: p, quaternion: q } = body.object;
    return { position: [p.x, p.y, p.z], quaternion: [q.w, q.x, q.y, q.z] };
  }
  function extentOf(name) { // lowest and highest corner [m] in the world of a body as drawn
    const body = bodies.find((item) => item.name === name), corner = new THREE.Vector3(), least = new THREE.Vector3(Infinity, Infinity, Infinity), most = new THREE.Vector3(-Infinity, -Infinity, -Infinity);
    if (!body) return null;
    body.object.updateWorldMatrix(true, true);
    body.object.traverse((item) => {
      const vertices = item.isMesh ? item.geometry.attributes.position : { count: 0 };
      for (let i = 0; i < vertices.count; i++) {
        corner.fromBufferAttribute(vertices, i).applyMatrix4(item.matrixWorld);
        least.min(corner);
        most.max(corner);
      }
    });
    return [least.toArray(), most.toArray()];
  }
  function frame(clock) {
    requestAnimationFrame(frame);
    // a window that was hidden goes on where it stopped
    if (playing && previous !== null) seek(now >= last ? first : now + (rate * Math.min(clock - previous, 100)) / 1000);
    previous = clock;
    if (controls.update() || stale) draw();
  }
  applyTheme();
  fillLegend();
  seek(first);
  resize();
  setPlaying(playing);
  draw();
  Object.assign(window.acausal, {
    ready: true, times: Array.from(times), bodies: bodies.map((body) => body.name), poseOf, extentOf, home,
    camera: () => ({ position: camera.position.toArray(), target: controls.target.toArray() }),
    seek: (t) => { setPlaying(false); seek(t); draw(); }, follow: (name) => { follow(bodies.find((body) => body.name === name) || null); draw(); }, play: () => setPlaying(true), pause: () => setPlaying(false),
  });
  if (location.hash.startsWith("#t=")) window.acausal.seek(Number(location.hash.slice(3)));
  document.body.dataset.ready = "true";
  requestAnimationFrame(frame);
})();
