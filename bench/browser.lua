-- For wrk: requests as browsers and crawlers make them. Each is for a random one of the paths in the file that PATHS
-- names, half for Turtle and half for JSON-LD, with the header fields of a browser, and a trace of its own.
local paths = {}
local tags = {}

function init(args)
   math.randomseed(tonumber(os.getenv("SEED") or "1"))
   for line in io.lines(os.getenv("PATHS")) do
      local path, turtle, jsonld = line:match("(%S+) ?(%S*) ?(%S*)")
      paths[#paths + 1] = path
      tags[#paths] = { turtle, jsonld }
   end
   wrk.headers["User-Agent"] = "Mozilla/5.0 (X11; Linux x86_64; rv:140.0) Gecko/20100101 Firefox/140.0"
   wrk.headers["Accept-Language"] = "en-US,en;q=0.5"
   wrk.headers["Accept-Encoding"] = "gzip, deflate, br, zstd"
   wrk.headers["Connection"] = "keep-alive"
   wrk.headers["Sec-Fetch-Dest"] = "empty"
   wrk.headers["Sec-Fetch-Mode"] = "cors"
   wrk.headers["Sec-Fetch-Site"] = "same-origin"
   wrk.headers["Priority"] = "u=4"
end

local function hex(digits)
   local text = ""
   for _ = 1, digits do text = text .. string.format("%x", math.random(0, 15)) end
   return text
end

function request()
   local number = math.random(#paths)
   local kind = math.random(2)
   wrk.headers["Accept"] = kind == 1 and "text/turtle" or "application/ld+json"
   wrk.headers["Traceparent"] = "00-" .. hex(32) .. "-" .. hex(16) .. "-01"
   local tag = tags[number][kind]
   wrk.headers["If-None-Match"] = tag ~= "" and tag or nil
   return wrk.format("GET", paths[number])
end
