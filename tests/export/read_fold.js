// Reads FOLD files with two readers that this project has no part in, and prints what they make of them.
// Words: the folder of node_modules, then the files.
const fs = require("fs");
const { createRequire } = require("module");
const from = createRequire(process.argv[2] + "/");
const fold = from("fold");
const ear = from("rabbit-ear");

function readOne(path) {
  const file = JSON.parse(fs.readFileSync(path, "utf8"));
  return [file, ...file.file_frames].map((frame) => {
    const whole = frame === file ? frame : { ...file, ...frame };
    const byFold = fold.convert.deepCopy(whole);
    fold.convert.faces_vertices_to_faces_edges(byFold);
    const byEar = ear.graph.populate(fold.convert.deepCopy(whole));
    const { summary, vertices, edges, faces } = ear.graph.validate(whole);
    return {
      summary,
      references: [vertices.references, edges.references, faces.references],
      counts: [fold.filter.numVertices(whole), fold.filter.numEdges(whole), fold.filter.numFaces(whole)],
      assigned: { B: fold.filter.boundaryEdges(whole).length, V: fold.filter.valleyEdges(whole).length },
      duplicates: whole.edges_vertices.length - new Set(fold.filter.removeDuplicateEdges_vertices(byFold)).size,
      facesEdges: byFold.faces_edges,
      edgesFaces: byEar.edges_faces.map((each) => each.length),
    };
  });
}

console.log(JSON.stringify(process.argv.slice(3).map(readOne)));
