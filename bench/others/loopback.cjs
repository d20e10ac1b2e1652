// Preloaded (node -r) before servers that cannot be told on which address to listen: they listen on loopback alone.
const { Server } = require("net");
const listen = Server.prototype.listen;
Server.prototype.listen = function (where, ...rest) {
  if (where !== null && typeof where === "object") return listen.call(this, { ...where, host: "127.0.0.1" }, ...rest);
  return listen.call(this, Number(where), "127.0.0.1", ...rest.filter((each) => typeof each === "function"));
};
