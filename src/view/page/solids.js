// Shapes as meshes of three.js. The world's z axis points up; cylinders and capsules lie along z.

import * as THREE from "three";

/**
 * @param {import("./link.js").Shape} shape
 * @returns {THREE.BufferGeometry}
 */
function geometry(shape) {
  switch (shape.kind) {
    case "cylinder":
      return new THREE.CylinderGeometry(shape.radius, shape.radius, 2 * shape.half_height, 40).rotateX(Math.PI / 2);
    case "capsule":
      return new THREE.CapsuleGeometry(shape.radius, 2 * shape.half_length, 8, 24).rotateX(Math.PI / 2);
    case "sphere":
      return new THREE.SphereGeometry(shape.radius, 32, 20);
    case "cuboid":
      return new THREE.BoxGeometry(...shape.half_sides.map((half) => 2 * half));
    default: {
      const mesh = new THREE.BufferGeometry();
      mesh.setAttribute("position", new THREE.Float32BufferAttribute(shape.vertices.flat(), 3));
      mesh.setIndex(shape.triangles.flat());
      const flat = mesh.toNonIndexed();
      flat.computeVertexNormals();
      return flat;
    }
  }
}

/**
 * @param {import("./link.js").Solid} solid
 * @param {{opacity?: number}} [how]
 * @returns {THREE.Mesh}
 */
export function mesh(solid, { opacity = 1 } = {}) {
  const [red, green, blue] = solid.color.map((channel) => channel / 255);
  const material = new THREE.MeshStandardMaterial({
    color: new THREE.Color().setRGB(red, green, blue, THREE.SRGBColorSpace), roughness: 0.65, metalness: 0.05,
    transparent: opacity < 1, opacity, side: solid.shape.kind === "mesh" ? THREE.DoubleSide : THREE.FrontSide, depthWrite: opacity === 1,
  });
  return new THREE.Mesh(geometry(solid.shape), material);
}

/**
 * Puts an object at a pose: position (m) and quaternion (x, y, z, w).
 * @param {THREE.Object3D} object
 * @param {ArrayLike<number>} pose
 * @param {number} [at]
 */
export function put(object, pose, at = 0) {
  object.position.set(pose[at], pose[at + 1], pose[at + 2]);
  object.quaternion.set(pose[at + 3], pose[at + 4], pose[at + 5], pose[at + 6]);
}

/** @param {THREE.Object3D} object */
export function dispose(object) {
  object.traverse((part) => {
    if (part instanceof THREE.Mesh || part instanceof THREE.Line || part instanceof THREE.Points) {
      part.geometry.dispose();
      part.material.dispose();
    }
  });
}
