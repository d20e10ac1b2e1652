-- For wrk: requests as browsers and crawlers make them. Each is for a random one of the paths in the file that PATHS
-- names, half for Turtle and half for JSON-LD, with the header fields of one of several browsers in random order, and a
-- trace of its own.
local paths = {}
local tags = {}
local browsers = {
   "Mozilla/5.0 (X11; Linux x86_64; rv:140.0) Gecko/20100101 Firefox/140.0",
   "Mozilla/5.0 (Windows NT 10.0; Win64; x64) AppleWebKit/537.36 (KHTML, like Gecko) Chrome/138.0.0.0 Safari/537.36",
   "Mozilla/5.0 (Macintosh; Intel Mac OS X 10_15_7) AppleWebKit/605.1.15 (KHTML, like Gecko) Version/18.5 Safari/605.1.15",
}
local languages = { "en-US,en;q=0.5", "de-DE,de;q=0.9,en;q=0.8", "fr" }

function init(args)
   math.randomseed(tonumber(os.getenv("SEED") or "1"))
   for line in io.lines(os.getenv("PATHS")) do
      local path, turtle, jsonld = line:match("(%S+) ?(%S*) ?(%S*)")
      paths[#paths + 1] = path
      tags[#paths] = { turtle, jsonld }
   end
end

local function hex(digits)
   local text = ""
   for _ = 1, digits do text = text .. string.format("%x", math.random(0, 15)) end
   return text
end

local function shuffled(fields)
   for last = #fields, 2, -1 do
      local other = math.random(last)
      fields[last], fields[other] = fields[other], fields[last]
   end
   return fields
end

function request()
   local number = math.random(#paths)
   local kind = math.random(2)
   local fields = {
      "Host: " .. wrk.headers["Host"],
      "User-Agent: " .. browsers[math.random(#browsers)],
      "Accept: " .. (kind == 1 and "text/turtle" or "application/ld+json"),
      "Accept-Language: " .. languages[math.random(#languages)],
      "Accept-Encoding: gzip, deflate, br, zstd",
      "Connection: keep-alive",
      "Sec-Fetch-Dest: empty",
      "Sec-Fetch-Mode: cors",
      "Sec-Fetch-Site: same-origin",
      "Priority: u=4",
      "Traceparent: 00-" .. hex(32) .. "-" .. hex(16) .. "-01",
   }
   local tag = tags[number][kind]
   if tag ~= "" then fields[#fields + 1] = "If-None-Match: " .. tag end
   return "GET " .. paths[number] .. " HTTP/1.1\r\n" .. table.concat(shuffled(fields), "\r\n") .. "\r\n\r\n"
end
