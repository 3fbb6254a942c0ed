"use strict";
(() => {
  const views = [...document.querySelectorAll(".view")].map((node) => ({
    name: node.dataset.name,
    images: Object.fromEntries([...node.querySelectorAll("img")].map((image) => [image.dataset.key, image])),
  }));
  if (views.length === 0) return;
  const titles = Object.fromEntries(Object.entries(views[0].images).map(([key, image]) => [key, image.alt]));

  // The slider: two pictures of one view, the upper one cut at the handle.
  const compare = document.querySelector(".compare");
  compare.hidden = false;
  const [under, over] = compare.querySelectorAll(".stage img");
  const [tagA, tagB] = compare.querySelectorAll(".tag");
  const [viewChoice, choiceA, choiceB] = compare.querySelectorAll("select");
  const stage = compare.querySelector(".stage");
  const slider = compare.querySelector("input");
  const show = () => {
    const view = views[Number(viewChoice.value)];
    under.src = view.images[choiceA.value].src;
    over.src = view.images[choiceB.value].src;
    under.alt = tagA.textContent = titles[choiceA.value];
    over.alt = tagB.textContent = titles[choiceB.value];
  };
  const place = () => stage.style.setProperty("--at", slider.value + "%");
  [viewChoice, choiceA, choiceB].forEach((choice) => choice.addEventListener("change", show));
  slider.addEventListener("input", place);
  show();
  place();

  // Zoom: drag to move, wheel to scale, keys 1-4 to flip between pictures in place.
  const zoom = document.getElementById("zoom");
  const pane = zoom.querySelector(".pane");
  const picture = pane.querySelector("img");
  const buttons = zoom.querySelector(".choices");
  let current = null, keys = [], scale = 1, x = 0, y = 0, before = null;
  const draw = () => {
    picture.style.transform = `translate(${x}px, ${y}px) scale(${scale})`;
    picture.classList.toggle("near", scale >= 4);
  };
  const fit = () => {
    const w = picture.naturalWidth, h = picture.naturalHeight;
    scale = Math.min(pane.clientWidth / w, pane.clientHeight / h);
    x = (pane.clientWidth - w * scale) / 2;
    y = (pane.clientHeight - h * scale) / 2;
    draw();
  };
  const choose = (key) => {
    if (!keys.includes(key)) return;
    picture.src = current.images[key].src;
    picture.alt = titles[key];
    [...buttons.children].forEach((button) => button.setAttribute("aria-pressed", button.dataset.key === key));
  };
  const scaleAt = (factor, cx, cy) => {
    const next = Math.min(32, Math.max(0.1, scale * factor));
    x = cx - (cx - x) * next / scale;
    y = cy - (cy - y) * next / scale;
    scale = next;
    draw();
  };
  const open = (view, key) => {
    current = view;
    keys = Object.keys(view.images);
    zoom.querySelector(".name").textContent = view.name;
    buttons.replaceChildren(...keys.map((each, index) => {
      const button = document.createElement("button");
      button.textContent = `${index + 1} ${titles[each]}`;
      button.dataset.key = each;
      button.addEventListener("click", () => choose(each));
      return button;
    }));
    before = document.activeElement;
    zoom.classList.add("open");
    choose(key);
    picture.decode().then(fit, fit);
    zoom.querySelector(".close").focus();
  };
  const close = () => {
    zoom.classList.remove("open");
    if (before) before.focus();
  };
  document.querySelectorAll(".view").forEach((node, index) =>
    node.querySelectorAll("button").forEach((button) =>
      button.addEventListener("click", () => open(views[index], button.querySelector("img").dataset.key))));
  zoom.querySelector(".close").addEventListener("click", close);
  zoom.querySelector(".fit").addEventListener("click", fit);
  pane.addEventListener("wheel", (event) => {
    event.preventDefault();
    const box = pane.getBoundingClientRect();
    scaleAt(Math.exp(-event.deltaY / 400), event.clientX - box.left, event.clientY - box.top);
  }, { passive: false });
  pane.addEventListener("pointerdown", (event) => pane.setPointerCapture(event.pointerId));
  pane.addEventListener("pointermove", (event) => {
    if (!event.buttons) return;
    x += event.movementX;
    y += event.movementY;
    draw();
  });
  pane.addEventListener("dblclick", (event) => {
    const box = pane.getBoundingClientRect();
    scaleAt(2, event.clientX - box.left, event.clientY - box.top);
  });
  document.addEventListener("keydown", (event) => {
    if (!zoom.classList.contains("open")) return;
    if (event.key === "Escape") close();
    else if (event.key === "+" || event.key === "=") scaleAt(1.5, pane.clientWidth / 2, pane.clientHeight / 2);
    else if (event.key === "-") scaleAt(1 / 1.5, pane.clientWidth / 2, pane.clientHeight / 2);
    else if (event.key === "0") fit();
    else if (/^[1-9]$/.test(event.key)) choose(keys[Number(event.key) - 1]);
  });
})();
