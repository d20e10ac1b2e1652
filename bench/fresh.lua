-- For wrk: every request says something that none before has said.
local number = 0

function request()
   number = number + 1
   wrk.headers["x-request-id"] = tostring(number)
   return wrk.format()
end
