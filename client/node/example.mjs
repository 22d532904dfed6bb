// How far is the nearest surface, now and in a second? From the .proto files alone:
//   node example.mjs [ADDRESS] [MAP]     (default: 127.0.0.1:50051 and the map `default`)
import {fileURLToPath} from 'node:url';
import grpc from '@grpc/grpc-js';
import loader from '@grpc/proto-loader';

const protos = process.env.CLEARANCE_PROTO ?? fileURLToPath(new URL('../../proto', import.meta.url));
const {clearance} = grpc.loadPackageDefinition(
    loader.loadSync('clearance/v1/query.proto', {includeDirs: [protos], keepCase: true, longs: Number}));

const [address = '127.0.0.1:50051', map = ''] = process.argv.slice(2);
const target = address.startsWith('/') ? `unix:${address}` : address;
const query = new clearance.v1.QueryService(target, grpc.credentials.createInsecure());
const points = new Float32Array([10, 2, 0.5, 5, 0, 0.5]);

function queryPoints(horizon_s) {
  const request = {map, positions_f32: Buffer.from(points.buffer), horizon_s, gradients: true};
  return new Promise((resolve, reject) => query.QueryPoints(
      request, (error, reply) => error ? reject(error) : resolve(reply)));
}

// Bulk arrays are little-endian bytes; a copy aligns them.
const floats = bytes => new Float32Array(Uint8Array.from(bytes).buffer);

try {
  const [now, later] = [await queryPoints(0), await queryPoints(1)];
  const distances = floats(now.distances_f32), ahead = floats(later.distances_f32);
  distances.forEach((d, i) => console.log(
      `${d.toFixed(2)} m, state ${now.states_u8[i] & 3}, in a second ${ahead[i].toFixed(2)} m`));
} catch (error) {
  console.error(`${error.code} ${error.details}`);
  process.exitCode = 1;
} finally {
  query.close();
}
