// node-wot with one thing of one property, which anybody may read: node wot.cjs FOLDER PORT
const [folder, port] = process.argv.slice(2);
const { Servient } = require(`${folder}/node_modules/@node-wot/core`);
const { HttpServer } = require(`${folder}/node_modules/@node-wot/binding-http`);

(async () => {
  const servient = new Servient();
  servient.addServer(new HttpServer({ port: Number(port), address: "127.0.0.1" }));
  const wot = await servient.start();
  const thing = await wot.produce({
    title: "probe",
    securityDefinitions: { nosec_sc: { scheme: "nosec" } },
    security: ["nosec_sc"],
    properties: { temperature: { type: "number", readOnly: true, observable: true } },
  });
  thing.setPropertyReadHandler("temperature", async () => 21.5);
  await thing.expose();
})();
